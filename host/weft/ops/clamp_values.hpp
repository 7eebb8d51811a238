// Values clamped to what is physical: kernels/clamp_values.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

// values[i] = min(max(values[i], 0), largest) for i < count, in place; NaN gives 0. Does not wait.
void clamp_values(Device& device, std::size_t count, float largest, Buffer& values);

}  // namespace weft::ops
