// Floats to stored values, between all encodings and to all types, at sizes about the vector (8
// values) and the chunk (2048 values).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/tiles.hpp"
#include "support/matchers.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/reference/tile.hpp"
#include "weft/tensor/half.hpp"

namespace weft::test {
namespace {

constexpr Encoding encodings[] = {Encoding::linear, Encoding::srgb, Encoding::gamma22};
constexpr double unit = float_roundoff;
// what OpenCL grants pow(): 16 units in the last place
constexpr double pow_error = 32 * unit;
constexpr double smallest_float = 0x1p-149;

// A magnitude with a bound of its error in float.
struct Bounded {
  double value = 0;
  double error = 0;
};

// value^exponent, where the base has an error and the exponent is rounded to float (2 u, for it may
// be a quotient): d(x^e) = x^e (e dx / x + ln x de).
Bounded power(Bounded base, double exponent) {
  if (base.value == 0) return {0, std::pow(base.error, exponent)};
  const double result = std::pow(base.value, exponent);
  const double relative = exponent * base.error / base.value +
                          2 * unit * exponent * std::abs(std::log(base.value)) + pow_error;
  return {result, result * relative + smallest_float};
}

// The error of a value that went through the curves in float.
double curve_error(double value, Encoding from, Encoding to) {
  if (from == to) return 0;
  Bounded x{std::abs(value), 0};
  if (from == Encoding::srgb) {
    if (x.value <= 0.04045) {
      x = {x.value / 12.92, 2 * unit * x.value / 12.92 + smallest_float};
    } else {
      // two constants, a sum and a quotient are rounded
      const double base = (x.value + 0.055) / 1.055;
      x = power({base, 4 * unit * base}, 2.4);
    }
  } else if (from == Encoding::gamma22) {
    x = power(x, 2.2);
  }
  if (to == Encoding::srgb) {
    if (x.value <= 0.0031308) return 12.92 * x.error + 2 * unit * 12.92 * x.value + smallest_float;
    const Bounded curve = power(x, 1 / 2.4);
    return 1.055 * curve.error + 4 * unit * 1.055 * curve.value;
  }
  if (to == Encoding::gamma22) return power(x, 1 / 2.2).error;
  return x.error;
}

// Half the distance of neighbours among the stored values near `value`.
double rounding(DType dtype, double value) {
  if (dtype == DType::u8) return (0.5 + 255 * unit) / 255;
  if (dtype == DType::f16) return std::max(0x1p-25, half_roundoff * std::abs(value));
  return 0.0;
}

std::vector<std::byte> transcode(std::span<const float> values, Encoding from, Encoding to,
                                 DType dtype) {
  GuardedBuffer in(shared_device(), values, "in");
  GuardedBuffer out(shared_device(), values.size() * size_of(dtype), "out");
  ops::transcode_tile(shared_device(), values.size(), in.buffer(), from, to, dtype, out.buffer());
  std::vector<std::byte> bytes = out.values<std::byte>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(in.intact());
  return bytes;
}

void expect_transcoded(std::span<const float> values, Encoding from, Encoding to, DType dtype) {
  SCOPED_TRACE(testing::Message() << values.size() << " values, " << name_of(from) << " to "
                                  << name_of(to) << ", " << name_of(dtype));
  std::vector<double> expected(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    expected[i] = reference::transcode(double{values[i]}, from, to, dtype);
  }
  EXPECT_TRUE(all_near(
      decode_values(transcode(values, from, to, dtype), dtype), expected, [&](std::size_t i) {
        return curve_error(double{values[i]}, from, to) + rounding(dtype, expected[i]);
      }));
}

TEST(TranscodeTile, SmallOfEveryKind) {
  const std::vector<float> values = random_floats(19, 1, -0.2, 1.2);
  // every pair of curves once, and every type with and without one
  for (const Encoding from : encodings) {
    for (const Encoding to : encodings) expect_transcoded(values, from, to, DType::f32);
  }
  for (const DType dtype : {DType::u8, DType::f16}) {
    expect_transcoded(values, Encoding::linear, Encoding::linear, dtype);
    expect_transcoded(values, Encoding::linear, Encoding::srgb, dtype);
  }
}

TEST(TranscodeTile, StraddlesVectorsAndChunks) {
  for (const std::size_t count : Sizes{1, 7, 8, 9, 2047, 2048, 2049, 4100}) {
    const std::vector<float> values = random_floats(count, 2, -0.2, 1.2);
    for (const DType dtype : raw_types) {
      expect_transcoded(values, Encoding::linear, Encoding::srgb, dtype);
      expect_transcoded(values, Encoding::linear, Encoding::linear, dtype);
    }
  }
}

TEST(TranscodeTile, CurvesAboutTheirKneesAndFarOut) {
  std::vector<float> values;
  for (const float at : {0.0f, 0.003f, 0.0031308f, 0.0034f, 0.038f, 0.04045f, 0.043f, 1.0f, 1e-30f,
                         1e-10f, 30.0f, 1e6f, 1e15f}) {
    for (const float sign : {1.0f, -1.0f}) {
      values.push_back(sign * at);
      values.push_back(sign * std::nextafter(at, 0.0f));
      values.push_back(sign * std::nextafter(at, 1e30f));
    }
  }
  for (const Encoding from : encodings) {
    for (const Encoding to : encodings) expect_transcoded(values, from, to, DType::f32);
  }
}

// Between equal encodings a float passes as it is, NaN and all.
TEST(TranscodeTile, EqualEncodingsChangeNothing) {
  std::vector<float> values = random_floats(2100, 3, -1.0, 1.0);
  values[0] = unused;
  values[1] = -0.0f;
  values[2] = 0x1p-149f;
  values[2099] = -std::numeric_limits<float>::infinity();
  for (const Encoding encoding : encodings) {
    const std::vector<std::byte> bytes = transcode(values, encoding, encoding, DType::f32);
    EXPECT_EQ(std::memcmp(bytes.data(), values.data(), bytes.size()), 0);
  }
}

TEST(TranscodeTile, BytesAreClampedAndRoundedToNearest) {
  std::vector<float> values;
  std::vector<int> expected;
  for (int byte = 0; byte < 256; ++byte) {
    // the value itself, and just short of the middles to its neighbours
    for (const double offset : {0.0, -0.499, 0.499}) {
      values.push_back(static_cast<float>((byte + offset) / 255));
      expected.push_back(byte);
    }
  }
  const float infinity = std::numeric_limits<float>::infinity();
  for (const float low : {-0.0f, -1e-30f, -0.5f, -1e30f, -infinity, unused, -unused}) {
    values.push_back(low);
    expected.push_back(0);
  }
  for (const float high : {1.0001f, 2.0f, 1e30f, infinity}) {
    values.push_back(high);
    expected.push_back(255);
  }
  // in whole vectors, and as the last few
  for (std::size_t shift = 0; shift < 8; ++shift) {
    const std::vector<std::byte> bytes =
        transcode(std::span(values).subspan(shift), Encoding::linear, Encoding::linear, DType::u8);
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      EXPECT_EQ(static_cast<int>(bytes[i]), expected[i + shift]) << values[i + shift];
    }
  }
  // the library's conversion on the host agrees
  for (std::size_t i = 0; i < values.size(); ++i) {
    EXPECT_EQ(nearest_byte(double{values[i]}), expected[i]);
  }
}

// Finite values stay finite; NaN and infinities stay what they are.
TEST(TranscodeTile, HalvesAreRoundedToEvenAndFiniteOnesStayFinite) {
  const float infinity = std::numeric_limits<float>::infinity();
  std::vector<float> values{0.0f,     -0.0f,     1.0f,       65504.0f, -65504.0f, 65519.9f,
                            65520.0f, -65520.0f, 1e30f,      -1e30f,   infinity,  -infinity,
                            0x1p-24f, 0x1p-25f,  0x1.8p-25f, 0x1p-14f, -0x1p-26f, 0x1p-149f,
                            2049.0f,  2051.0f,   2048.5f,    unused};
  const std::vector<float> more = random_floats(50, 4, -70000.0, 70000.0);
  values.insert(values.end(), more.begin(), more.end());
  // each among the last few of some run too
  for (const float last : {65520.0f, -infinity, unused, -1e30f, infinity, 65504.0f, 0x1p-25f}) {
    values.push_back(last);
  }
  for (std::size_t shift = 0; shift < 8; ++shift) {
    const std::span<const float> part = std::span(values).subspan(shift);
    const std::vector<std::byte> bytes =
        transcode(part, Encoding::linear, Encoding::linear, DType::f16);
    for (std::size_t i = 0; i < part.size(); ++i) {
      std::uint16_t half = 0;
      std::memcpy(&half, &bytes[2 * i], 2);
      if (std::isnan(part[i])) {
        EXPECT_TRUE(std::isnan(half_to_float(half)));
        continue;
      }
      const float clamped =
          std::isinf(part[i]) ? part[i] : std::clamp(part[i], -half_max, half_max);
      EXPECT_EQ(half, float_to_half(clamped)) << part[i];
    }
  }
}

}  // namespace
}  // namespace weft::test
