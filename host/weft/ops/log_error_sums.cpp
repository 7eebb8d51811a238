#include "weft/ops/log_error_sums.hpp"

#include <fmt/core.h>

#include <vector>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t chunk_values = 2048;
}  // namespace

LogErrorSums log_error_sums(Device& device, const TileShape& tile, const Buffer& raw,
                            const Buffer& decoded, double scale) {
  const std::size_t chunks = ceil_div(tile.values(), chunk_values);
  Buffer partial(device, chunks * 2 * sizeof(float), "partial log errors");
  const cl_kernel kernel = device.kernel(
      kernel_sources::log_error_sums,
      fmt::format("{} -DCHUNK={}", value_options(tile.dtype, tile.nan_zero), chunk_values),
      "log_error_sums");
  set_arguments(kernel, raw, decoded, ulong(tile.values()), static_cast<float>(scale), partial);
  launch_items(device, kernel, chunks);
  std::vector<float> host(chunks * 2);
  device.read(partial, std::span<float>(host));
  LogErrorSums sums;
  sums.count = tile.values();
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    sums.square_difference += static_cast<double>(host[2 * chunk]);
    sums.square_reference += static_cast<double>(host[2 * chunk + 1]);
  }
  return sums;
}

}  // namespace weft::ops
