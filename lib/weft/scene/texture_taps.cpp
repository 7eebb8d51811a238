#include "weft/scene/texture_taps.hpp"

#include <algorithm>
#include <cmath>

#include "weft/btf/mip.hpp"

namespace weft {
namespace {

// Two neighbours along an axis of `side` texels.
struct AxisTaps {
  std::size_t first = 0, second = 0;
  double fraction = 0;  // of the second
};

AxisTaps axis_taps(double coordinate, std::size_t side) {
  const double wrapped = coordinate - std::floor(coordinate);
  const double position = wrapped * static_cast<double>(side) - 0.5;
  const double below = std::floor(position);
  const auto first = static_cast<std::size_t>(below + static_cast<double>(side)) % side;
  return {first, (first + 1) % side, position - below};
}

}  // namespace

TexelTaps texel_taps(std::array<float, 2> uv, std::size_t height, std::size_t width) {
  const AxisTaps x = axis_taps(static_cast<double>(uv[0]), width);
  const AxisTaps y = axis_taps(1 - static_cast<double>(uv[1]), height);
  const auto index = [width](std::size_t row, std::size_t column) {
    return static_cast<std::uint32_t>(row * width + column);
  };
  const auto weight = [](double row, double column) { return static_cast<float>(row * column); };
  return {{index(y.first, x.first), index(y.first, x.second), index(y.second, x.first),
           index(y.second, x.second)},
          {weight(1 - y.fraction, 1 - x.fraction), weight(1 - y.fraction, x.fraction),
           weight(y.fraction, 1 - x.fraction), weight(y.fraction, x.fraction)}};
}

MipTaps mip_taps(std::array<float, 2> footprint, std::size_t height, std::size_t width) {
  const auto [shorter, longer] = std::minmax(footprint[0], footprint[1]);
  const double extent = std::max(static_cast<double>(shorter), static_cast<double>(longer) / 2);
  const double texels = extent * static_cast<double>(std::max(height, width));
  if (!(texels > 1)) return {};  // so also for NaN
  const auto last = static_cast<double>(last_mip_level(height, width));
  const double level = std::min(std::log2(texels), last);
  const double finer = std::floor(level);
  return {static_cast<std::size_t>(finer), static_cast<float>(level - finer)};
}

}  // namespace weft
