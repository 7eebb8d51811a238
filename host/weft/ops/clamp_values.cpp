#include "weft/ops/clamp_values.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {

void clamp_values(Device& device, std::size_t count, float largest, Buffer& values) {
  constexpr std::size_t chunk = 2048;
  const cl_kernel kernel =
      device.kernel(kernel_sources::clamp_values, fmt::format("-DCHUNK={}", chunk), "clamp_values");
  set_arguments(kernel, values, ulong(count), largest);
  launch_items(device, kernel, ceil_div(count, chunk));
}

}  // namespace weft::ops
