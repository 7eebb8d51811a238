// IEEE binary16 on the host: exact widening, and narrowing with round-to-nearest-even. Values past
// 65504 become infinities, small ones subnormals or zero; NaN stays NaN.
#pragma once

#include <cstdint>
#include <span>

namespace weft {

inline constexpr float half_max = 65504.0f;

float half_to_float(std::uint16_t bits);
std::uint16_t float_to_half(float value);

// Element-wise; both spans have the same size.
void half_to_float(std::span<const std::uint16_t> from, std::span<float> to);
void float_to_half(std::span<const float> from, std::span<std::uint16_t> to);

}  // namespace weft
