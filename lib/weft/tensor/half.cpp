#include "weft/tensor/half.hpp"

#include <Imath/half.h>

#include <algorithm>

namespace weft {

float half_to_float(std::uint16_t bits) {
  return imath_half_to_float(bits);
}

std::uint16_t float_to_half(float value) {
  return imath_float_to_half(value);
}

void half_to_float(std::span<const std::uint16_t> from, std::span<float> to) {
  std::transform(from.begin(), from.end(), to.begin(), imath_half_to_float);
}

void float_to_half(std::span<const float> from, std::span<std::uint16_t> to) {
  std::transform(from.begin(), from.end(), to.begin(), imath_float_to_half);
}

}  // namespace weft
