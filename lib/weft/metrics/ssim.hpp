// Structural similarity of two images (Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment:
// From Error Visibility to Structural Similarity, IEEE TIP 2004, eq. (13)):
//
//   SSIM(x, y) = (2 mu_x mu_y + C1) (2 cov_xy + C2) / ((mu_x^2 + mu_y^2 + C1) (var_x + var_y + C2))
//   C1 = (0.01 L)^2,  C2 = (0.03 L)^2
//
// The means, variances and the covariance of a window are weighted by a Gaussian of sigma 1.5
// texels on 11 x 11 texels, whose weights sum to 1 (population covariance). The similarity of two
// images is the mean over all windows that lie inside them, and over channels. L is the peak of the
// PSNR.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>

namespace weft {

inline constexpr std::size_t ssim_window = 11;

// The weights of one axis; a window's are their products.
std::array<double, ssim_window> ssim_weights();

// Throws an input error that names the sizes if no window fits into an image of that size, or if
// the peak is not finite and positive.
void check_ssim(std::size_t height, std::size_t width, double peak);

// SSIM of two images [Y][X][C], in double. NaN where a value is.
double ssim(std::size_t height, std::size_t width, std::size_t channels, std::span<const double> x,
            std::span<const double> y, double peak);

// Similarities of the images of a BTF, one by one.
struct SsimSums {
  std::size_t images = 0;
  double sum = 0;
  double lowest = std::numeric_limits<double>::infinity();  // NaN if any is

  void add(double similarity);
  void merge(const SsimSums& other);
  double mean() const { return sum / static_cast<double>(images); }
};

}  // namespace weft
