#include "weft/ops/permute.hpp"

#include "weft/ops/launch.hpp"

namespace weft::ops {

void permute(Device& device, const std::array<std::size_t, 3>& sizes,
             const std::array<std::size_t, 3>& steps, const Buffer& in, std::size_t first_out,
             Buffer& out) {
  const cl_kernel kernel = device.kernel(kernel_sources::permute, "", "permute");
  set_arguments(kernel, ulong(sizes[1]), ulong(sizes[2]), ulong(steps[0]), ulong(steps[1]),
                ulong(steps[2]), in, ulong(first_out), out);
  launch_items(device, kernel, sizes[0]);
}

}  // namespace weft::ops
