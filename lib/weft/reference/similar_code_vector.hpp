// The most similar code-vector of each of many vectors, by structural similarity (Havran et al.
// 2010, section 4.4.2, equation 5). A value x of a vector is a texel of an image, which has the
// mean mu and the standard deviation sigma in the window about it: that of weft/metrics/ssim.hpp,
// 11 x 11 texels, Gaussian. A code-vector is compared by what it does to these images where it
// takes the texel's place: with d = s L_j - x for a luminance and A_j - x for a chromaticity, and
// the window's weight w of its centre,
//
//   mu_y      = mu + w d
//   sigma_y^2 = sigma^2 + 2 w d (x - mu) + w (1 - w) d^2
//   sigma_xy  = sigma^2 + w d (x - mu)
//
// and the similarity is eq. (5) of these:
//
//   SSIM = N M / ((N + p) (M + q))      N = 2 mu mu_y + C1           p = w^2 d^2
//                                       M = 2 sigma_xy + C2          q = w (1 - w) d^2
//   1 - SSIM = (p (M + q) + q N) / ((N + p) (M + q))
//
// A vector and a code-vector have as many similarities as values, of all channels alike. Their
// dissimilarity is the 98th percentile of 1 - SSIM: that which 98 % of the values do not exceed, by
// the nearest rank, so that less than 50 values have no outlier. The paper says that percentile,
// and "2 % of outliers". It does not say what surrounds a texel of a code-vector; as code-vectors
// are of no place, the window is the vector's own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/reference/nearest_code_vector.hpp"

namespace weft {

// Of images whose values are at most about 1: the range L of C1 = (0.01 L)^2, C2 = (0.03 L)^2.
struct SimilarityConstants {
  double c1 = 0;
  double c2 = 0;
  double centre = 0;  // w
};
SimilarityConstants similarity_constants();

// Values of n that may be less similar than the percentile.
constexpr std::size_t similarity_outliers(std::size_t n) {
  return n / 50;
}

// Deviations that images can have: a window holds its centre, so that sigma^2 is at least
// w / (1 - w) (x - mu)^2. Interpolated ones are raised to that.
void raise_deviations(std::span<const float> rows, std::span<const float> means,
                      std::span<float> deviations);

// A search whose distances are dissimilarities, and thresholds too.
class SimilarSearch : public NearestSearch {
 public:
  double distance(const VectorShape& shape, const ScaledVectors& vector, const float* code_vector,
                  double most) const override;
  double distance_of(double threshold, const VectorShape& shape) const override;
};

namespace reference {

// 1 - SSIM of a texel's window when the texel becomes `y`.
double window_dissimilarity(const SimilarityConstants& constants, double x, double mean,
                            double deviation, double y);

// The dissimilarity of one vector and one code-vector; infinity where it exceeds `most`, which is
// known as soon as too many values do.
double code_vector_dissimilarity(const VectorShape& shape, const ScaledVectors& vector,
                                 const float* code_vector, double most);

class PlainSimilarSearch final : public SimilarSearch {
 public:
  void set(const VectorShape& shape, std::span<const float> code_vectors) override;
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors, double most) override;

 private:
  VectorShape shape_;
  std::vector<float> code_vectors_;
};

}  // namespace reference
}  // namespace weft
