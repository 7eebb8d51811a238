// Tensors of three modes with their modes in another order: kernels/permute.cl.
#pragma once

#include <array>
#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

// out[first_out + (i J + j) K + k] = in[i steps[0] + j steps[1] + k steps[2]] for sizes {I, J, K}.
void permute(Device& device, const std::array<std::size_t, 3>& sizes,
             const std::array<std::size_t, 3>& steps, const Buffer& in, std::size_t first_out,
             Buffer& out);

}  // namespace weft::ops
