#include "weft/reference/local_moments.hpp"

#include <algorithm>
#include <cmath>

namespace weft {
namespace {

// The place in [0, n) of one that is `offset` - `back` away from 0, by mirrors at both ends.
std::size_t mirrored(std::size_t offset, std::size_t back, std::size_t n) {
  if (n == 1) return 0;
  const std::size_t period = 2 * (n - 1);
  const std::size_t at = (offset + period * back - back) % period;
  return std::min(at, period - at);
}

}  // namespace

LocalMoments::LocalMoments(std::size_t height, std::size_t width, std::size_t channels)
    : height_(height),
      width_(width),
      channels_(channels),
      weights_(ssim_weights()),
      sums_((width + 2 * reach) * channels),
      squares_(sums_.size()) {}

LocalMoments::Band LocalMoments::band(std::size_t from, std::size_t to) const {
  // mirrored rows are among those that are there
  return {from - std::min(from, reach), std::min(to + reach, height_)};
}

void LocalMoments::take_row(std::span<const double> rows, std::size_t first, std::size_t y) {
  const std::size_t row = width_ * channels_;
  double* const sums = sums_.data() + reach * channels_;
  double* const squares = squares_.data() + reach * channels_;
  std::fill(sums, sums + row, 0.0);
  std::fill(squares, squares + row, 0.0);
  for (std::size_t t = 0; t < ssim_window; ++t) {
    const double weight = weights_[t];
    const double* const values = rows.data() + (mirrored(y + t, reach, height_) - first) * row;
    for (std::size_t i = 0; i < row; ++i) {
      const double weighted = weight * values[i];
      sums[i] += weighted;
      squares[i] += weighted * values[i];
    }
  }
  for (std::size_t t = 0; t < reach; ++t) {
    const std::size_t before = reach + mirrored(t, reach, width_);
    const std::size_t behind = reach + mirrored(width_ + reach + t, reach, width_);
    for (std::vector<double>* const columns : {&sums_, &squares_}) {
      const auto at = [&](std::size_t column) {
        return columns->begin() + static_cast<std::ptrdiff_t>(column * channels_);
      };
      std::copy_n(at(before), channels_, at(t));
      std::copy_n(at(behind), channels_, at(reach + width_ + t));
    }
  }
}

void LocalMoments::about(std::size_t x, std::span<float> means, std::span<float> deviations) const {
  for (std::size_t c = 0; c < channels_; ++c) {
    double mean = 0, square = 0;
    for (std::size_t t = 0; t < ssim_window; ++t) {
      mean += weights_[t] * sums_[(x + t) * channels_ + c];
      square += weights_[t] * squares_[(x + t) * channels_ + c];
    }
    means[c] = static_cast<float>(mean);
    deviations[c] = static_cast<float>(std::sqrt(std::max(square - mean * mean, 0.0)));
  }
}

}  // namespace weft
