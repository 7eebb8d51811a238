// Squared norm of a buffer: kernels/sum_squares.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// sum of values[i]^2, i < count, added in double where the device has it. Waits for the device.
double sum_squares(Device& device, std::size_t count, const Buffer& values, Arithmetic arithmetic);

}  // namespace weft::ops
