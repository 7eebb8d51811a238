// Multi-level vector quantisation (Havran et al. 2010): the fit, step by step over an engine that
// searches and resamples, and the engine and the decoder of the reference.
//
//   1. one pass over the images: values are checked, and those of some texels kept
//   2. code-books of the first of these, and with larger thresholds of the others (5.1.1)
//   3. all texels, block by block: each takes the nearest apparent BRDF, and its mean luminance
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/vq.hpp"
#include "weft/reference/nearest_code_vector.hpp"
#include "weft/reference/vq_code_books.hpp"

namespace weft {

struct VqRequest {
  VqGrid grid;
  // For the root mean square of differences, as parts of the data's root mean square luminance.
  VqThresholds thresholds;
  double first_part = 0.01;   // of the texels, that code-books begin with
  double second_part = 0.04;  // that they are completed with
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
  virtual NearestSearch& search() = 0;
  // Values [images][count][C] of texels as rows of texel_vector().
  virtual void resample(std::span<const float> values, std::size_t count,
                        std::span<float> rows) = 0;
};

// Rows of the values in their measured directions.
void measured_rows(const BtfShape& shape, std::span<const float> values, std::size_t count,
                   std::span<float> rows);

// Texels that are resampled together, and bytes that a fit holds on the host beside its engine, the
// code-vectors' limit among them.
std::size_t vq_block(const BtfInfo& source, const VqRequest& request);
MemoryPlan plan_vq(const BtfInfo& source, const VqRequest& request, const Job& job);

struct VqFit {
  std::unique_ptr<VqModel> model;  // unrounded; its info holds nothing yet
  double luminance = 0;            // root mean square, that thresholds are parts of
  std::size_t trained = 0;         // texels
};

class VqFitter {
 public:
  // The first step. `source` and `engine` must outlive it.
  VqFitter(TileSource& source, VqEngine& engine, const VqRequest& request, Job& job);

  // The others, with these thresholds in place of the request's.
  VqFit fit(const VqThresholds& thresholds);

 private:
  void read();
  // Rows of texels [first, first + count) of the training.
  std::vector<float> training_rows(std::size_t first, std::size_t count) const;
  // Entries and scales of all texels.
  void assign(VqModel& model, const VqCodeBooks& books);

  TileSource& source_;
  VqEngine& engine_;
  VqRequest request_;
  Job& job_;
  BtfShape shape_;
  VectorShape vector_;
  VqTraining training_;
  std::vector<float> kept_;  // values of the training [images][texels][C], scaled
  int unit_ = 0;             // exponent of that scale
};

namespace reference {

std::unique_ptr<VqEngine> vq_engine(const BtfInfo& source, const VqRequest& request);

// Images [first, first + count) of a model, [count][Y][X][C].
void decode_vq(const VqModel& model, std::size_t first, std::size_t count, std::span<double> out);

}  // namespace reference
}  // namespace weft
