#include "weft/btf/encoding.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "support/generators.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using test::decode_values;
using test::encode_values;

TEST(Encoding, KnownValues) {
  EXPECT_DOUBLE_EQ(decode_to_linear(Encoding::linear, 0.3), 0.3);
  // 0.5 of sRGB is ((0.5 + 0.055) / 1.055)^2.4.
  EXPECT_NEAR(decode_to_linear(Encoding::srgb, 0.5), 0.21404114048223255, 1e-15);
  EXPECT_NEAR(decode_to_linear(Encoding::srgb, 0.04), 0.04 / 12.92, 1e-17);
  EXPECT_NEAR(decode_to_linear(Encoding::gamma22, 0.5), 0.217637640824031, 1e-15);
  EXPECT_DOUBLE_EQ(encode_from_linear(Encoding::srgb, 1.0), 1.0);
  EXPECT_DOUBLE_EQ(encode_from_linear(Encoding::gamma22, 0.0), 0.0);
  EXPECT_NEAR(encode_from_linear(Encoding::srgb, 0.18), 0.46135612950044164, 1e-15);
}

TEST(Encoding, InverseOverAndBeyondTheUnitRangeAndOddBelowZero) {
  for (const Encoding encoding : {Encoding::linear, Encoding::srgb, Encoding::gamma22}) {
    for (const double value : {0.0, 1e-6, 0.003, 0.0405, 0.2, 0.7, 1.0, 3.0, 300.0}) {
      // The two pieces of sRGB meet within 1e-7 only: that much the constants of the standard
      // leave.
      EXPECT_NEAR(encode_from_linear(encoding, decode_to_linear(encoding, value)), value,
                  1e-7 + 1e-14 * value);
      EXPECT_EQ(decode_to_linear(encoding, -value), -decode_to_linear(encoding, value));
      EXPECT_EQ(encode_from_linear(encoding, -value), -encode_from_linear(encoding, value));
    }
  }
}

TEST(Encoding, BytesSurviveLinearLight) {
  for (const Encoding encoding : {Encoding::linear, Encoding::srgb, Encoding::gamma22}) {
    const std::array<float, 256> table = linear_of_bytes(encoding);
    for (std::size_t byte = 0; byte < 256; ++byte) {
      EXPECT_EQ(nearest_byte(encode_from_linear(encoding, static_cast<double>(table[byte]))), byte);
    }
  }
}

TEST(Encoding, NearestByteRoundsAndClips) {
  EXPECT_EQ(nearest_byte(0.4999 / 255), 0);
  EXPECT_EQ(nearest_byte(0.5001 / 255), 1);
  EXPECT_EQ(nearest_byte(-1), 0);
  EXPECT_EQ(nearest_byte(2), 255);
  EXPECT_EQ(nearest_byte(std::numeric_limits<double>::infinity()), 255);
  EXPECT_EQ(nearest_byte(std::nan("")), 0);
}

std::vector<double> converted(std::vector<double> values, Representation from, Representation to) {
  const std::vector<std::byte> bytes = encode_values(values, from.dtype);
  std::vector<std::byte> out(values.size() * size_of(to.dtype));
  convert_values(from, bytes, to, out, "file");
  return decode_values(out, to.dtype);
}

TEST(ConvertValues, BetweenTypesAndEncodings) {
  const Representation u8{DType::u8, Encoding::srgb};
  const Representation f16{DType::f16, Encoding::linear};
  const Representation f32{DType::f32, Encoding::linear};
  EXPECT_EQ(converted({0, 1, 128.0 / 255}, u8, u8), (std::vector<double>{0, 1, 128.0 / 255}));
  const double linear = decode_to_linear(Encoding::srgb, 128.0 / 255);
  EXPECT_NEAR(converted({128.0 / 255}, u8, f32)[0], linear, linear * 0x1p-24);
  EXPECT_NEAR(converted({128.0 / 255}, u8, f16)[0], linear, linear * 0x1p-11);
  EXPECT_EQ(converted({linear, -1, 7}, f32, u8), (std::vector<double>{128.0 / 255, 0, 1}));
  EXPECT_EQ(converted({0.5, 1024, -3}, f32, f16), (std::vector<double>{0.5, 1024, -3}));
  EXPECT_EQ(converted({0.5, 1024, -3}, f16, f32), (std::vector<double>{0.5, 1024, -3}));
}

TEST(ConvertValues, WhatHalfCannotHoldIsNamed) {
  const Representation f32{DType::f32, Encoding::linear};
  const Representation f16{DType::f16, Encoding::linear};
  EXPECT_EQ(converted({65504, 65519}, f32, f16), (std::vector<double>{65504, 65504}));
  EXPECT_TRUE(std::isinf(converted({std::numeric_limits<double>::infinity()}, f32, f16)[0]));
  try {
    converted({1, 70000}, f32, f16);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_STREQ(error.what(), "file: value 70000 is beyond the range of F16 (65504)");
  }
}

}  // namespace
}  // namespace weft
