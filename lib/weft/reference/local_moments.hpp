// Mean and standard deviation of the windows about texels of an image: those of structural
// similarity, weft/metrics/ssim.hpp, here about every texel. The image goes on beyond its edges as
// a mirror shows it, without the edge again.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "weft/metrics/ssim.hpp"

namespace weft {

class LocalMoments {
 public:
  LocalMoments(std::size_t height, std::size_t width, std::size_t channels);

  // Rows [first, end) of the image that the windows about rows [from, to) reach.
  struct Band {
    std::size_t first = 0;
    std::size_t end = 0;
  };
  Band band(std::size_t from, std::size_t to) const;

  // Takes row y; `rows` holds those from `first` on, [row][X][C], all that its windows reach.
  void take_row(std::span<const double> rows, std::size_t first, std::size_t y);
  // The moments about texel x of that row, [C] each.
  void about(std::size_t x, std::span<float> means, std::span<float> deviations) const;

 private:
  static constexpr std::size_t reach = ssim_window / 2;

  std::size_t height_, width_, channels_;
  std::array<double, ssim_window> weights_;
  std::vector<double> sums_, squares_;  // of columns, [reach + X + reach][C]
};

}  // namespace weft
