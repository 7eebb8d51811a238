#include "weft/btf/view_grid.hpp"

#include <algorithm>
#include <cmath>

namespace weft {

std::array<double, 3> ViewGrid::direction(std::size_t entry) const {
  const auto centre = [&](std::size_t cell) {
    return (2 * static_cast<double>(cell) + 1) / static_cast<double>(side_) - 1;
  };
  const double p = centre(entry % side_);
  const double q = centre(entry / side_);
  const double square = p * p + q * q;
  if (square >= 1) return {p / std::sqrt(square), q / std::sqrt(square), 0};
  return {2 * p / (1 + square), 2 * q / (1 + square), (1 - square) / (1 + square)};
}

std::size_t ViewGrid::entry(const std::array<double, 3>& direction) const {
  std::array<double, 3> d = direction;
  if (d[2] < 0) d[2] = 0;
  const double length = std::hypot(d[0], d[1], d[2]);
  if (length == 0) d = {1, 0, 0};
  const double depth = (length == 0 ? 1 : length) + d[2];
  const auto cell = [&](double offset) {
    const auto n = static_cast<double>(side_);
    return static_cast<std::size_t>(std::clamp((offset / depth + 1) / 2 * n, 0.0, n - 1));
  };
  return cell(d[1]) * side_ + cell(d[0]);
}

}  // namespace weft
