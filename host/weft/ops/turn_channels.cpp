#include "weft/ops/turn_channels.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {

void turn_channels(Device& device, std::size_t images, std::size_t channels, std::size_t texels,
                   const Buffer& from, Buffer& to) {
  constexpr std::size_t texels_of_item = 2048;
  const cl_kernel kernel = device.kernel(
      kernel_sources::turn_channels,
      fmt::format("-DCHANNELS={} -DTEXELS={}", channels, texels_of_item), "turn_channels");
  set_arguments(kernel, ulong(texels), from, to);
  launch_items(device, kernel, ceil_div(texels, texels_of_item), images);
}

}  // namespace weft::ops
