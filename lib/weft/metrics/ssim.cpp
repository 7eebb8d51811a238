#include "weft/metrics/ssim.hpp"

#include <cmath>
#include <vector>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr double sigma = 1.5;

// Weighted means of all windows inside an image: [Y - 10][(X - 10) C] of values [Y][X C].
class WindowMeans {
 public:
  WindowMeans(std::size_t height, std::size_t width, std::size_t channels)
      : height_(height), row_(width * channels), channels_(channels) {}

  std::size_t rows() const { return height_ - (ssim_window - 1); }
  std::size_t columns() const { return row_ - (ssim_window - 1) * channels_; }

  // Of f(i), i the index of a value.
  template <typename F>
  std::vector<double> of(const F& f) const {
    std::vector<double> along_rows(height_ * columns());
    for (std::size_t y = 0; y < height_; ++y) {
      for (std::size_t j = 0; j < columns(); ++j) {
        double sum = 0;
        for (std::size_t t = 0; t < ssim_window; ++t) {
          sum += weights_[t] * f(y * row_ + j + t * channels_);
        }
        along_rows[y * columns() + j] = sum;
      }
    }
    std::vector<double> means(rows() * columns());
    for (std::size_t y = 0; y < rows(); ++y) {
      for (std::size_t j = 0; j < columns(); ++j) {
        double sum = 0;
        for (std::size_t t = 0; t < ssim_window; ++t) {
          sum += weights_[t] * along_rows[(y + t) * columns() + j];
        }
        means[y * columns() + j] = sum;
      }
    }
    return means;
  }

 private:
  std::size_t height_;
  std::size_t row_;
  std::size_t channels_;
  std::array<double, ssim_window> weights_ = ssim_weights();
};

}  // namespace

std::array<double, ssim_window> ssim_weights() {
  std::array<double, ssim_window> weights{};
  double sum = 0;
  constexpr std::size_t centre = ssim_window / 2;
  for (std::size_t t = 0; t < ssim_window; ++t) {
    const double distance = static_cast<double>(t) - static_cast<double>(centre);
    weights[t] = std::exp(-distance * distance / (2 * sigma * sigma));
    sum += weights[t];
  }
  for (double& weight : weights) weight /= sum;
  return weights;
}

void check_ssim(std::size_t height, std::size_t width, double peak) {
  if (height < ssim_window || width < ssim_window) {
    fail_input("SSIM needs images of at least {0} x {0} texels; these have {1} x {2} (Y x X)",
               ssim_window, height, width);
  }
  if (!(std::isfinite(peak) && peak > 0)) fail_input("SSIM needs a positive peak, not {}", peak);
}

double ssim(std::size_t height, std::size_t width, std::size_t channels, std::span<const double> x,
            std::span<const double> y, double peak) {
  check_ssim(height, width, peak);
  const WindowMeans means(height, width, channels);
  const std::vector<double> mean_x = means.of([&](std::size_t i) { return x[i]; });
  const std::vector<double> mean_y = means.of([&](std::size_t i) { return y[i]; });
  const std::vector<double> mean_xx = means.of([&](std::size_t i) { return x[i] * x[i]; });
  const std::vector<double> mean_yy = means.of([&](std::size_t i) { return y[i] * y[i]; });
  const std::vector<double> mean_xy = means.of([&](std::size_t i) { return x[i] * y[i]; });
  const double c1 = (0.01 * peak) * (0.01 * peak);
  const double c2 = (0.03 * peak) * (0.03 * peak);
  double sum = 0;
  for (std::size_t i = 0; i < mean_x.size(); ++i) {
    const double mu_x = mean_x[i];
    const double mu_y = mean_y[i];
    const double variances = mean_xx[i] - mu_x * mu_x + mean_yy[i] - mu_y * mu_y;
    const double covariance = mean_xy[i] - mu_x * mu_y;
    sum += (2 * mu_x * mu_y + c1) * (2 * covariance + c2) /
           ((mu_x * mu_x + mu_y * mu_y + c1) * (variances + c2));
  }
  return sum / static_cast<double>(mean_x.size());
}

void SsimSums::add(double similarity) {
  merge({1, similarity, similarity});
}

void SsimSums::merge(const SsimSums& other) {
  images += other.images;
  sum += other.sum;
  if (std::isnan(other.lowest) || other.lowest < lowest) lowest = other.lowest;
}

}  // namespace weft
