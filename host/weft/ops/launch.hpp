// What the launchers share.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft::ops {

inline std::uint64_t ulong(std::size_t value) {
  return value;
}

constexpr std::size_t ceil_div(std::size_t a, std::size_t b) {
  return (a + b - 1) / b;
}
constexpr std::size_t round_up(std::size_t a, std::size_t b) {
  return ceil_div(a, b) * b;
}

// Launches a kernel whose work-groups are single work-items. Nothing for an empty range.
void launch_items(Device& device, cl_kernel kernel, std::size_t x, std::size_t y = 1,
                  std::size_t z = 1);

// Lanes of the vectors that the CPU-shaped kernels use on this device, and columns of a panel.
std::size_t vector_width(const Device& device, Arithmetic arithmetic = Arithmetic::f32);
std::size_t panel_width(const Device& device, Arithmetic arithmetic = Arithmetic::f32);

// "-DARITHMETIC=32 -DVW=8": the options every panel kernel is built with.
std::string vector_option(const Device& device, Arithmetic arithmetic = Arithmetic::f32);

// An input error that names the device if it doesn't compute in that arithmetic.
void require_arithmetic(const Device& device, Arithmetic arithmetic);

// Calls f(float{}) or f(double{}): the type of a kernel's real arguments.
template <typename F>
void with_real(Arithmetic arithmetic, const F& f) {
  if (arithmetic == Arithmetic::f32) {
    f(float{});
  } else {
    f(double{});
  }
}

// "-DVALUE=.. -DNAN_ZERO=.." of tile_values.cl.
std::string value_options(DType dtype, bool nan_zero);

}  // namespace weft::ops
