// Multi-level vector quantisation (Havran et al. 2010): the fit, step by step over an engine that
// searches and resamples, and the engine and the decoder of the reference.
//
//   1. one pass over the images: values are checked, and those of some texels kept
//   2. code-books of the first of these, and with larger thresholds of the others (5.1.1)
//   3. all texels, block by block: each takes the nearest apparent BRDF, and its mean luminance
//
// These are the steps of one source; vq_joint_fit.hpp takes them for one or more.
//
// Weights are refused: those of texels have no place in code-books that all texels share, and those
// of measured directions are no weights of nodes between them.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "weft/btf/resampling.hpp"
#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/vq.hpp"
#include "weft/reference/local_moments.hpp"
#include "weft/reference/nearest_code_vector.hpp"
#include "weft/reference/vq_code_books.hpp"

namespace weft {

// What thresholds bound and what is nearest: the root mean square of differences, as parts of the
// data's root mean square luminance (nearest_code_vector.hpp), or the dissimilarity of windows
// (similar_code_vector.hpp).
enum class VqSimilarity { mse, ssim };

struct VqRequest {
  VqGrid grid;
  VqSimilarity similarity = VqSimilarity::mse;
  VqThresholds thresholds;
  double first_part = 0.01;   // of the texels, that code-books begin with
  double second_part = 0.04;  // that they are completed with
  std::size_t levels = 1;     // mip levels that are fitted, the texels themselves among them
};

// Texels that code-books are made of: of the first and of the second step. At least 256 and 768 of
// them, or all, and at most 1024 and 3072.
struct VqTraining {
  std::size_t first = 0;
  std::vector<std::size_t> texels;  // in their order, a Halton sequence over the image
};
VqTraining vq_training(const BtfShape& shape, const VqRequest& request);

class VqEngine {
 public:
  virtual ~VqEngine() = default;
  // By the request's similarity.
  virtual NearestSearch& search() = 0;
  // Values [images][count][C] of texels as rows of texel_vector().
  virtual void resample(std::span<const float> values, std::size_t count,
                        std::span<float> rows) = 0;
  // Operations of that for one texel; 0 where directions stay.
  virtual double resampling_flops() const = 0;
};

// Times 2^exponent.
void scale_all(std::span<float> values, int exponent);

// Operations of the products with a resampling's matrices, for one value of a texel.
double resampling_flops(const Resampling& resampling);

// Rows of the values in their measured directions.
void measured_rows(const BtfShape& shape, std::span<const float> values, std::size_t count,
                   std::span<float> rows);

// Texels that are resampled together, and that are read together; and bytes that a fit holds on the
// host beside its engine, the code-vectors' limit among them.
std::size_t vq_block(const BtfInfo& source, const VqRequest& request);
std::size_t vq_read_block(const BtfInfo& source, const VqRequest& request);
// `trained`: texels that code-books are made of, those of other sources among them.
MemoryPlan plan_vq(const BtfInfo& source, const VqRequest& request, std::size_t trained,
                   const Job& job);

class VqFitter {
 public:
  // `source` and `engine` must outlive it.
  VqFitter(TileSource& source, VqEngine& engine, const VqRequest& request, Job& job);

  // The first step; returns the largest magnitude.
  double read();
  // What values are multiplied with, 2^unit, before the steps that follow; once behind the first.
  void set_unit(int unit);
  // The second step, with these thresholds in place of the request's; returns the root mean square
  // luminance, times 2^unit, of which they are parts.
  double train(VqCodeBooks& books, const VqThresholds& thresholds);
  // The third: entries of P4, and scales times 2^unit. It does not take the first two.
  VqCodeBook assign(const VqCodeBooks& books);

 private:
  // Texels in their measured directions [images][texels][C]: values, and for structural similarity
  // the moments about them.
  struct Measured {
    std::size_t texels = 0;
    std::vector<float> values, means, deviations;
  };
  // Rows of texel_vector() of the same.
  struct Vectors {
    std::vector<float> rows, means, deviations;
    std::vector<float> scales;
    ScaledVectors view() const { return {rows, scales, means, deviations}; }
  };

  bool structural() const { return request_.similarity == VqSimilarity::ssim; }
  void make_room(Measured& measured, std::size_t texels) const;
  void scale(Measured& measured) const;
  // The moments about the training's texels in image i.
  void keep_moments(std::span<const double> image, std::size_t i);
  // Texels [first, first + count) of the source.
  void read_block(std::size_t first, std::size_t count, Measured& block);
  void read_with_moments(std::size_t first, std::size_t count, Measured& block);
  // Texels [first, first + count) of what was measured, resampled.
  Vectors vectors(const Measured& measured, std::size_t first, std::size_t count) const;

  TileSource& source_;
  VqEngine& engine_;
  VqRequest request_;
  Job& job_;
  BtfShape shape_;
  VectorShape vector_;
  VqTraining training_;
  Measured kept_;  // of the training, scaled
  LocalMoments moments_;
  std::vector<std::size_t> row_by_row_;  // the training's texels in the image's order
  int unit_ = 0;                         // exponent of the scale
};

namespace reference {

std::unique_ptr<VqEngine> vq_engine(const BtfInfo& source, const VqRequest& request);

// Images [first, first + count) of a model, [count][Y][X][C].
void decode_vq(const VqModel& model, std::size_t first, std::size_t count, std::span<double> out);

}  // namespace reference
}  // namespace weft
