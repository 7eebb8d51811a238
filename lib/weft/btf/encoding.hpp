// From stored values to linear light and back, one value at a time and whole tiles.
//
//   srgb      u <= 0.04045 ? u / 12.92 : ((u + 0.055) / 1.055)^2.4        (IEC 61966-2-1)
//   gamma2.2  u^2.2
//
// Both are continued to negative values as odd functions, f(-u) = -f(u), so that averaging and
// conversion stay defined for what a fit may overshoot; above 1 the formulas simply go on. 8-bit
// values stand for u = byte / 255.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

#include "weft/btf/btf.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft {

// Linear light of a stored value, and the stored value of linear light.
double decode_to_linear(Encoding encoding, double stored);
double encode_from_linear(Encoding encoding, double linear);

// Linear light of each of the 256 values of 8-bit data.
std::array<float, 256> linear_of_bytes(Encoding encoding);

// u in [0, 1] to the nearest byte; below and above are clipped, NaN gives 0.
unsigned char nearest_byte(double value);

// How values are stored: their type and their encoding.
struct Representation {
  DType dtype = DType::f32;
  Encoding encoding = Encoding::linear;
  bool operator==(const Representation&) const = default;
};

// Rewrites values from one representation in another: the same count of them in both spans, U8, F16
// or F32. Narrowing rounds to nearest; to U8 it clips to [0, 1], which is what a display shows. To
// F16 a finite value beyond its range is an input error that names `where` and the value.
void convert_values(Representation from, std::span<const std::byte> values, Representation to,
                    std::span<std::byte> out, std::string_view where);

}  // namespace weft
