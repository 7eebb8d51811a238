// F16 storage with scales: what the format promises, at both ends of float's range.
#include "weft/model/component_scale.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "support/generators.hpp"
#include "weft/model/model.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

constexpr float float_max = std::numeric_limits<float>::max();
constexpr float float_min = std::numeric_limits<float>::min();
constexpr float denorm_min = std::numeric_limits<float>::denorm_min();

std::vector<std::uint32_t> bits_of(std::span<const float> values) {
  std::vector<std::uint32_t> bits;
  for (const float value : values) bits.push_back(std::bit_cast<std::uint32_t>(value));
  return bits;
}

TEST(ComponentLayout, SplitsAtTheAxis) {
  const std::vector<std::size_t> shape{2, 3, 4};
  const auto expect = [&](std::size_t axis, std::size_t outer, std::size_t components,
                          std::size_t inner) {
    const ComponentLayout layout = component_layout(shape, axis);
    EXPECT_EQ(layout.outer, outer) << "axis " << axis;
    EXPECT_EQ(layout.components, components) << "axis " << axis;
    EXPECT_EQ(layout.inner, inner) << "axis " << axis;
  };
  expect(0, 1, 2, 12);
  expect(1, 2, 3, 4);
  expect(2, 6, 4, 1);
  expect(ModelTensor::no_component_axis, 1, 1, 24);
}

TEST(ComponentScale, PutsTheLargestHalfBelow2To15) {
  test::Random random(5);
  for (int exponent = -149; exponent < 128; ++exponent) {
    for (int i = 0; i < 20; ++i) {
      const auto value = std::ldexp(static_cast<float>(random.uniform(1, 2)), exponent) *
                         (i % 2 == 0 ? 1.0f : -1.0f);
      const std::vector<float> values{value, value / 3, 0.0f};
      const ComponentLayout layout{1, 1, 3};
      const float scale = component_scales(values, layout)[0];
      int scale_exponent = 0;
      ASSERT_EQ(std::frexp(scale, &scale_exponent), 0.5f) << value;
      ASSERT_TRUE(std::isnormal(scale)) << value;
      std::vector<std::uint16_t> halves(3);
      to_scaled_half(values, layout, {&scale, 1}, halves);
      const float largest = std::abs(half_to_float(halves[0]));
      ASSERT_LT(largest, 0x1p15f) << value;
      if (scale > float_min) {
        ASSERT_GE(largest, 0x1p14f) << value;
      }
    }
  }
}

TEST(ComponentScale, RoundsToHalfPrecisionAndIsIdempotent) {
  // Nearest of 11 bits: |error| <= 2^-11 |value|, also at the very top of the range, where there is
  // no half above to round to. Halves are spaced by at least 2^-24 and the largest is at least
  // 2^14: |error| <= 2^-39 of it. Nothing is finer than half of float's own smallest step.
  test::Random random(6);
  for (int exponent = -149; exponent < 128; ++exponent) {
    std::vector<float> values;
    for (int i = 0; i < 32; ++i) {
      const double magnitude = std::ldexp(random.uniform(1, 2), exponent - i);
      values.push_back(static_cast<float>(std::min(magnitude, double{float_max}) *
                                          (random.uniform() < 0.5 ? -1 : 1)));
    }
    const double largest = std::abs(double{values[0]});
    std::vector<float> rounded = values;
    const ComponentLayout layout{1, 1, values.size()};
    round_to_scaled_half(rounded, layout);
    for (std::size_t i = 0; i < values.size(); ++i) {
      ASSERT_TRUE(std::isfinite(rounded[i])) << values[i];
      const double tolerance = std::max(
          {std::abs(double{values[i]}) * 0x1p-11, largest * 0x1p-39, double{denorm_min} / 2});
      ASSERT_LE(std::abs(double{rounded[i]} - double{values[i]}), tolerance)
          << values[i] << " beside " << largest;
    }
    std::vector<float> again = rounded;
    round_to_scaled_half(again, layout);
    ASSERT_EQ(bits_of(again), bits_of(rounded)) << "exponent " << exponent;
    // Storing what was rounded loses nothing.
    const std::vector<float> scales = component_scales(rounded, layout);
    std::vector<std::uint16_t> halves(rounded.size());
    std::vector<float> read(rounded.size());
    to_scaled_half(rounded, layout, scales, halves);
    from_scaled_half(halves, layout, scales, read);
    ASSERT_EQ(bits_of(read), bits_of(rounded)) << "exponent " << exponent;
  }
}

TEST(ComponentScale, EdgesOfTheRange) {
  // Just below a power of two: rounding to half carries into the next binade.
  const float below = std::nextafter(0x1p-20f, 0.0f);
  for (const float value :
       {below, -below, float_max, -float_max, float_min, denorm_min, -denorm_min, 1023 * denorm_min,
        std::nextafter(0x1p-111f, 0.0f), 65504.0f, 1e-38f, 1e38f}) {
    // Beside it the finest value that its scale still holds, and signed zeros.
    std::vector<float> values{value, value * 0x1p-38f, 0.0f, -0.0f};
    const ComponentLayout layout{1, 1, values.size()};
    round_to_scaled_half(values, layout);
    EXPECT_TRUE(std::isfinite(values[0])) << value;
    EXPECT_EQ(std::signbit(values[0]), std::signbit(value)) << value;
    EXPECT_FALSE(std::signbit(values[2]));
    EXPECT_TRUE(std::signbit(values[3]));
    std::vector<float> again = values;
    round_to_scaled_half(again, layout);
    EXPECT_EQ(bits_of(again), bits_of(values)) << value;
  }
  // The nearest half is the power of two, also for the largest value of a component.
  std::vector<float> carried{below, 0x1p-21f};
  round_to_scaled_half(carried, {1, 1, 2});
  EXPECT_EQ(carried[0], 0x1p-20f);
  EXPECT_EQ(carried[1], 0x1p-21f);
  std::vector<float> smallest{denorm_min, -denorm_min, 2 * denorm_min};
  const std::vector<float> wanted = smallest;
  round_to_scaled_half(smallest, {1, 1, 3});
  EXPECT_EQ(bits_of(smallest), bits_of(wanted));
}

TEST(ComponentScale, EachComponentHasItsOwn) {
  // [outer 2][components 3][inner 2], magnitudes 1e-38, 0 and 1e38.
  const std::vector<float> values{1e-38f, -2e-38f, 0, 0,    1e38f,  2e38f,
                                  4e-38f, 1e-38f,  0, 0.0f, -3e38f, 1.0f};
  const ComponentLayout layout{2, 3, 2};
  const std::vector<float> scales = component_scales(values, layout);
  ASSERT_EQ(scales.size(), 3u);
  EXPECT_EQ(scales[0], 0x1p-126f);  // the smallest
  EXPECT_EQ(scales[1], 1.0f);
  EXPECT_EQ(scales[2], 0x1p113f);  // 3e38 is in [2^127, 2^128)
  std::vector<float> rounded = values;
  round_to_scaled_half(rounded, layout);
  for (std::size_t i = 0; i + 1 < values.size(); ++i) {
    EXPECT_LE(std::abs(rounded[i] - values[i]), std::abs(values[i]) * 0x1p-11f) << i;
  }
  EXPECT_EQ(rounded.back(), 0.0f);  // 1 beside 3e38
}

TEST(ComponentScale, NoComponentsAndNoValues) {
  EXPECT_TRUE(component_scales({}, {5, 0, 1}).empty());
  EXPECT_EQ(component_scales({}, {0, 2, 1}), (std::vector<float>{1, 1}));
}

}  // namespace
}  // namespace weft
