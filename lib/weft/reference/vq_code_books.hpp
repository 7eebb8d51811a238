// The code-books of multi-level vector quantisation, level by level (Havran et al. 2010, sections
// 4.2, 4.3 and 5.1.1), over any search for nearest code-vectors.
//
// Texels come in batches. On each level, top down, a vector takes the nearest code-vector of
// earlier batches if that is within the level's threshold. The others take, in their order, the
// nearest of those that this batch added, or are added themselves:
//
//   P4 apparent BRDFs -> P3 views of one azimuth -> M hemispheres of lights
//     -> P2 their luminance -> P1 slices;   -> I2 their chromaticity -> I1 slices -> C
//
// Those that were added are cut into vectors of the level below. When a batch is done its
// code-vectors become what their indices and scales say, and that is what later ones are compared
// with: luminances as they are, where code-vectors take the vector's scale, its mean magnitude.
//
// Distances are the search's, and so is what a threshold says: the largest root mean square of
// differences (section 4.4.1), or the largest dissimilarity (4.4.2), which is that of luminances in
// P2 and P1, of chromaticities in C, I1 and I2, and of both in P4, P3 and M.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/model/vq.hpp"
#include "weft/reference/nearest_code_vector.hpp"

namespace weft {

// Thresholds of each code-book.
struct VqThresholds {
  double p4 = 0, p3 = 0, m = 0, p2 = 0, p1 = 0, i2 = 0, i1 = 0, c = 0;

  VqThresholds times(double factor) const;
};

// A texel's values on the grid: luminances [phi][theta][alpha][beta], then chromaticities
// [phi][theta][alpha][beta][C - 1].
VectorShape texel_vector(const VqGrid& grid, std::size_t channels);

// Mean magnitude.
float mean_magnitude(std::span<const float> values);

class VqCodeBooks {
 public:
  // `most_bytes` of code-vectors that it may hold.
  VqCodeBooks(const VqGrid& grid, std::size_t channels, std::size_t most_bytes);

  // Adds what texels, rows of texel_vector(), need; their scales are found here. Throws an input
  // error where the code-vectors would take more than most_bytes.
  void add(const ScaledVectors& texels, const VqThresholds& thresholds, NearestSearch& search);

  // The code-vectors of P4, rows of texel_vector().
  std::span<const float> apparent_brdfs() const { return levels_[p4].rows; }
  const VectorShape& apparent_brdf() const { return levels_[p4].shape; }
  std::size_t bytes() const { return bytes_; }

  // As a model whose texels are to be given.
  void fill(VqModel& model) const;

  // Begins with those of a model, of the same grid and channels, whose rows stay the first; its
  // chromaticities times 2^unit.
  void continue_from(const VqModel& model, int unit);

 private:
  enum LevelName : std::size_t { p4, p3, m, p2, p1, i2, i1, c, level_count };
  struct Level {
    VectorShape shape;
    std::size_t width = 0;                // entries of a row
    std::vector<float> rows;              // [size][shape], luminances of mean magnitude 1
    std::vector<std::uint32_t> children;  // [size][width]
    std::vector<float> scales;            // [size][width], of luminance
    std::size_t size() const { return rows.size() / shape.values(); }
  };
  // Vectors of one level on their way into its code-book: rows as they are, their scales, and what
  // is about their values where the search looks at that.
  struct Vectors {
    enum Plane : std::size_t { rows, means, deviations, plane_count };
    std::array<std::vector<float>, plane_count> planes;
    std::vector<float> scales;
    std::size_t size() const { return scales.size(); }
    ScaledVectors view() const { return {planes[rows], scales, planes[means], planes[deviations]}; }
    // Appends `count` values from the one at `first` on of all planes of `from`.
    void append(const ScaledVectors& from, std::size_t first, std::size_t count);
  };
  struct Assigned {
    std::vector<std::uint32_t> index;  // of each vector
    std::vector<std::size_t> added;    // vectors that became code-vectors
  };

  Assigned assign(LevelName name, const ScaledVectors& vectors, double threshold,
                  NearestSearch& search);
  // Cuts the added vectors into those of the level below, and assigns these.
  void descend(LevelName name, const ScaledVectors& vectors, const std::vector<std::size_t>& added,
               const VqThresholds& thresholds, NearestSearch& search);
  void enter(LevelName name, const ScaledVectors& vectors, const VqThresholds& thresholds,
             NearestSearch& search, std::vector<std::uint32_t>& indices);
  // Throws the input error for code-vectors beyond what they may take.
  void check_bytes() const;
  void append(Level& level, const float* row, float scale);
  // Rows from `first` on as their entries say.
  void rebuild(LevelName name, std::size_t first);

  VqGrid grid_;
  std::size_t chromaticities_;
  std::size_t most_bytes_;
  std::size_t bytes_ = 0;
  std::array<Level, level_count> levels_;
};

}  // namespace weft
