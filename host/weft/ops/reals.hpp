// Real numbers of a device's arithmetic from and to the host.
#pragma once

#include <cstddef>
#include <span>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// A buffer of the given values, rounded to the arithmetic.
Buffer real_buffer(Device& device, std::span<const double> values, Arithmetic arithmetic,
                   const char* what);

// Rows x columns values of a row-major matrix with a leading dimension, without what pads its rows,
// times `factor`. The product is rounded once, from double.
void read_reals(Device& device, const Buffer& from, Arithmetic arithmetic, std::size_t rows,
                std::size_t columns, std::size_t leading, double factor, std::span<float> to);
void read_reals(Device& device, const Buffer& from, Arithmetic arithmetic, std::size_t rows,
                std::size_t columns, std::size_t leading, double factor, std::span<double> to);

}  // namespace weft::ops
