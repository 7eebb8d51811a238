// Colour transforms inverted on the device, at sizes about the vector (8 texels) and the chunk
// (1024 texels), and channels picked.
#include "weft/ops/invert_colour.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"

namespace weft::test {
namespace {

using Kind = ColourTransform::Kind;
constexpr Kind all_kinds[] = {Kind::none, Kind::log, Kind::ycrcb, Kind::logluv, Kind::decorrelated};

bool takes_three(Kind kind) {
  return kind == Kind::ycrcb || kind == Kind::logluv;
}

ColourTransform of_kind(Kind kind, std::size_t channels, double scale = 0.5, double largest = 40) {
  ColourTransform transform;
  transform.kind = kind;
  if (!transform.is_linear()) transform.scale = scale, transform.largest = largest;
  if (kind == Kind::decorrelated) transform.axes = random_orthonormal(channels, channels, 5);
  for (std::size_t c = 0; c < channels; ++c) {
    transform.weights.push_back(1 + 0.25 * static_cast<double>(c));
  }
  return transform;
}

std::vector<float> inverted(const ColourTransform& transform, std::size_t channels,
                            std::span<const float> texels) {
  GuardedBuffer buffer(shared_device(), texels, "texels");
  const ops::InverseColour inverse(shared_device(), transform, channels);
  inverse.invert(shared_device(), texels.size() / channels, buffer.buffer());
  std::vector<float> values = buffer.values<float>();
  EXPECT_TRUE(buffer.intact());
  return values;
}

void expect_inverted(const ColourTransform& transform, std::size_t channels,
                     std::span<const float> texels) {
  SCOPED_TRACE(testing::Message() << name_of(transform.kind) << ", " << texels.size() / channels
                                  << " texels of " << channels << " channels");
  std::vector<double> expected(texels.begin(), texels.end());
  transform.invert_all(channels, expected);
  double largest = 0;
  for (const float t : texels) largest = std::max(largest, std::abs(double{t}));
  EXPECT_TRUE(all_near(inverted(transform, channels, texels), expected,
                       inverted_error(transform, channels, largest * float_roundoff)));
}

TEST(InvertColour, SmallOfEveryKind) {
  for (const Kind kind : all_kinds) {
    for (const std::size_t channels : Sizes{1, 3, 4}) {
      if (takes_three(kind) && channels != 3) continue;
      expect_inverted(of_kind(kind, channels), channels, random_floats(11 * channels, 3, -0.4, 2));
    }
  }
}

TEST(InvertColour, StraddlesVectorsAndChunks) {
  for (const Kind kind : all_kinds) {
    for (const std::size_t channels : Sizes{1, 2, 3, 31}) {
      if (takes_three(kind) && channels != 3) continue;
      for (const std::size_t texels : Sizes{1, 7, 8, 9, 1023, 1024, 1025, 3100}) {
        expect_inverted(of_kind(kind, channels), channels,
                        random_floats(texels * channels, texels, -0.4, 3));
      }
    }
  }
}

// The bound holds where it is far above the values, too: dark values are exact relative to s.
TEST(InvertColour, DarkValuesAreExactBesideBrightOnes) {
  ColourTransform transform;
  transform.kind = Kind::log;
  transform.scale = 1;
  transform.largest = 0x1p100;
  const std::vector<float> dark{0.0f, 0x1p-149f, -0x1p-126f, 1e-30f, -1e-10f, 1e-3f, 0.5f, -0.7f};
  std::vector<double> expected(dark.begin(), dark.end());
  transform.invert_all(1, expected);
  // 3 units in the last place of expm1 (6 u) and a product
  EXPECT_TRUE(all_near(inverted(transform, 1, dark), expected,
                       [&](std::size_t i) { return 8 * float_roundoff * std::abs(expected[i]); }));
}

TEST(InvertColour, OvershootsAndNanAreAsByTheReference) {
  const float infinity = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const double largest : {40.0, 65504.0, 0x1p100}) {
    for (const Kind kind : {Kind::log, Kind::logluv}) {
      ColourTransform transform = of_kind(kind, 3, largest / 0x1p40, largest);
      const std::vector<float> texels{1e30f,     -9,       9,         infinity, 0.1f, 0.1f,
                                      -infinity, infinity, -infinity, 200,      0,    0,
                                      0,         0,        0,         30,       -30,  30};
      std::vector<double> expected(texels.begin(), texels.end());
      transform.invert_all(3, expected);
      const std::vector<float> found = inverted(transform, 3, texels);
      EXPECT_TRUE(all_near(found, expected, inverted_error(transform, 3, 200 * float_roundoff)));
      for (const float value : found) EXPECT_TRUE(std::isfinite(value));
    }
  }
  const std::vector<float> found = inverted(of_kind(Kind::log, 3), 3, std::vector{nan, 1.0f, nan});
  EXPECT_TRUE(std::isnan(found[0]) && std::isfinite(found[1]) && std::isnan(found[2]));
  EXPECT_TRUE(std::isnan(inverted(of_kind(Kind::logluv, 3), 3, std::vector{nan, 0.0f, 0.0f})[0]));
}

TEST(PickChannels, SmallAndAboutTheChunk) {
  for (const std::size_t texels : Sizes{1, 9, 1023, 1024, 1025, 2050}) {
    if (is_simulator(shared_device()) && texels > 9) continue;
    const std::vector<std::uint32_t> list{3, 0};
    const std::vector<float> in = random_floats(texels * 4, 3);
    GuardedBuffer from(shared_device(), std::span<const float>(in), "in");
    GuardedBuffer channels(shared_device(), std::span<const std::uint32_t>(list), "list");
    GuardedBuffer to(shared_device(), (texels + 5) * 2 * sizeof(float), "out");
    std::vector<float> expected(10, -1.0f);
    shared_device().write(to.buffer(), std::span<const float>(expected));
    ops::pick_channels(shared_device(), texels, 4, from.buffer(), 2, channels.buffer(), 5,
                       to.buffer());
    for (std::size_t p = 0; p < texels; ++p) {
      expected.push_back(in[p * 4 + 3]);
      expected.push_back(in[p * 4]);
    }
    EXPECT_TRUE(all_equal(to.values<float>(), expected));
    EXPECT_TRUE(to.intact());
    EXPECT_TRUE(from.intact());
  }
}

}  // namespace
}  // namespace weft::test
