#include "weft/ops/ssim.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "weft/metrics/ssim.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t block_columns = 8;
constexpr std::size_t block_rows = 32;
}  // namespace

std::vector<double> ssim(Device& device, const TileShape& tile, std::size_t width,
                         const Buffer& raw, const Buffer& decoded, double peak) {
  if (tile.images == 0) return {};
  const std::size_t height = tile.texels / width;
  check_ssim(height, width, peak);
  // SSIM doesn't change with the unit: the peak is brought into [0.5, 1), so that squares stay in
  // range. Beyond 2^127 a power of two is no float.
  int exponent = 0;
  std::frexp(peak, &exponent);
  const int shift = std::clamp(-exponent, -126, 127);
  const double scaled_peak = std::ldexp(peak, shift);
  const double c1 = (0.01 * scaled_peak) * (0.01 * scaled_peak);
  const double c2 = (0.03 * scaled_peak) * (0.03 * scaled_peak);

  std::vector<float> weights;
  for (const double weight : ssim_weights()) weights.push_back(static_cast<float>(weight));
  Buffer device_weights(device, weights.size() * sizeof(float), "weights of SSIM");
  device.write(device_weights, std::span<const float>(weights));

  const std::size_t columns = (width - (ssim_window - 1)) * tile.channels;
  const std::size_t rows = height - (ssim_window - 1);
  const std::size_t blocks = ceil_div(columns, block_columns) * ceil_div(rows, block_rows);
  Buffer partial(device, tile.images * blocks * sizeof(float), "sums of SSIM");
  const cl_kernel kernel = device.kernel(
      kernel_sources::ssim,
      fmt::format("{} -DROWS={}", value_options(tile.dtype, tile.nan_zero), block_rows), "ssim");
  set_arguments(kernel, raw, decoded, device_weights, ulong(height), ulong(width * tile.channels),
                ulong(tile.channels), std::ldexp(1.0f, shift), static_cast<float>(c1),
                static_cast<float>(c2), partial);
  launch_items(device, kernel, ceil_div(columns, block_columns), ceil_div(rows, block_rows),
               tile.images);

  std::vector<float> host(tile.images * blocks);
  device.read(partial, std::span<float>(host));
  std::vector<double> similarities(tile.images);
  for (std::size_t image = 0; image < tile.images; ++image) {
    double sum = 0;
    for (std::size_t block = 0; block < blocks; ++block) {
      sum += static_cast<double>(host[image * blocks + block]);
    }
    similarities[image] = 1 - sum / static_cast<double>(rows * columns);
  }
  return similarities;
}

}  // namespace weft::ops
