// Colour transforms: their definitions, round trips to rounding, what is clamped, and their text.
#include "weft/btf/colour_transform.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"

namespace weft::test {
namespace {

using Kind = ColourTransform::Kind;
using Texel = std::vector<double>;

ColourTransform of_kind(Kind kind, std::size_t channels = 3, double scale = 1, double largest = 1) {
  ColourTransform transform;
  transform.kind = kind;
  transform.scale = scale;
  transform.largest = largest;
  if (kind == Kind::decorrelated) transform.axes = random_orthonormal(channels, channels, 5);
  return transform;
}

Texel applied(const ColourTransform& transform, Texel texel) {
  transform.apply(texel);
  return texel;
}

Texel inverted(const ColourTransform& transform, Texel texel) {
  transform.invert(texel);
  return texel;
}

TEST(ColourTransform, FollowsItsDefinitions) {
  const double e = 4 * double_roundoff;
  EXPECT_TRUE(all_near(applied(of_kind(Kind::log, 3, 0.25, 1), {0.25, -0.25, 0}),
                       Texel{std::log(2.0), -std::log(2.0), 0}, e));
  // BT.601: primaries reach +-0.5 of their difference
  const ColourTransform ycrcb = of_kind(Kind::ycrcb);
  EXPECT_TRUE(all_near(applied(ycrcb, {1, 1, 1}), Texel{1, 0, 0}, e));
  EXPECT_TRUE(all_near(applied(ycrcb, {1, 0, 0}), Texel{0.299, 0.5, -0.299 / 1.772}, e));
  EXPECT_TRUE(all_near(applied(ycrcb, {0, 0, 1}), Texel{0.114, -0.114 / 1.402, 0.5}, e));
  // D65 has u' = 0.1978, v' = 0.4683 (CIE 15); red of BT.709 has 0.4507, 0.5229; the matrix has
  // four digits, of which X of red is the first to be felt: 0.00005 / 0.41
  const LuvDecoding luv = luv_decoding();
  EXPECT_NEAR(luv.white_u, 0.1978, 5e-5);
  EXPECT_NEAR(luv.white_v, 0.4683, 5e-5);
  const ColourTransform logluv = of_kind(Kind::logluv);
  EXPECT_TRUE(all_near(applied(logluv, {1, 1, 1}), Texel{std::log(2.0), 0, 0}, e));
  const Texel red = applied(logluv, {1, 0, 0});
  EXPECT_NEAR(red[1] + luv.white_u, 0.4507, 2e-4);
  EXPECT_NEAR(red[2] + luv.white_v, 0.5229, 2e-4);
}

TEST(ColourTransform, BlackIsZeroAndComesBack) {
  for (const Kind kind : {Kind::none, Kind::log, Kind::ycrcb, Kind::logluv, Kind::decorrelated}) {
    const ColourTransform transform = of_kind(kind);
    EXPECT_EQ(applied(transform, {0, 0, 0}), (Texel{0, 0, 0})) << name_of(kind);
    EXPECT_EQ(inverted(transform, {0, 0, 0}), (Texel{0, 0, 0})) << name_of(kind);
  }
}

// In double: t is off by a few roundings, x by those times what the inverse makes of them.
TEST(ColourTransform, RoundTripsToRounding) {
  for (const double magnitude : {1.0, 65504.0, 1e30, 1e-30, 1e-42}) {
    for (const Kind kind : {Kind::log, Kind::ycrcb, Kind::logluv, Kind::decorrelated}) {
      ColourTransform transform = of_kind(kind, 3, std::max(magnitude / 16, 0x1p-126), magnitude);
      transform.weights = {2, 0.5, 1};
      const bool negative = kind != Kind::logluv;
      const std::vector<double> random = random_values(300, 7, negative ? -1 : 0, 1);
      // |t| is below 3 (log 17) for log, 1 for chromaticities, and 2 magnitudes for the linear ones
      const double t = transform.is_linear() ? 2 * magnitude : 3;
      const double tolerance = inverted_error(transform, 3, 8 * t * double_roundoff) -
                               inverted_error(transform, 3, 0) + 32 * magnitude * double_roundoff;
      for (std::size_t i = 0; i < random.size(); i += 3) {
        const Texel texel{random[i] * magnitude, random[i + 1] * magnitude,
                          random[i + 2] * magnitude};
        ASSERT_TRUE(all_near(inverted(transform, applied(transform, texel)), texel, tolerance))
            << name_of(kind) << " at " << magnitude;
      }
    }
  }
}

// The log keeps relative precision at both ends, through float: |dx| <= (s + |x|) |t| u.
TEST(ColourTransform, LogKeepsDarkAndBrightThroughFloat) {
  const ColourTransform transform = of_kind(Kind::log, 1, 0.5, 1e30);
  for (const double x : {0x1p-149, 1e-30, 1e-5, 0.25, 3.0, 65504.0, 1e10, 1e30}) {
    for (const double value : {x, -x}) {
      const double t = static_cast<double>(static_cast<float>(applied(transform, {value})[0]));
      const double bound = 1.01 * (0.5 + x) * (std::abs(t) * float_roundoff + 0x1p-149);
      EXPECT_NEAR(inverted(transform, {t})[0], value, bound);
    }
  }
}

TEST(ColourTransform, WhatAFitOvershootsStaysFinite) {
  const double infinity = std::numeric_limits<double>::infinity();
  const ColourTransform log = of_kind(Kind::log, 3, 1, 65504);
  EXPECT_TRUE(all_near(inverted(log, {1e30, -infinity, 88}), Texel{65504, -65504, 65504}, 1e-9));
  const ColourTransform luv = of_kind(Kind::logluv, 3, 1, 100);
  for (const Texel& texel : {Texel{1e6, 3, 9}, Texel{infinity, -infinity, -9}, Texel{50, 0, -0.47},
                             Texel{3, -0.2, 0.5}, Texel{-3, 0.1, 0.1}}) {
    for (const double value : inverted(luv, texel)) {
      EXPECT_GE(value, 0);
      EXPECT_LE(value, 100 * 40) << testing::PrintToString(texel);
    }
  }
  EXPECT_EQ(inverted(luv, {-1, 0, 0}), (Texel{0, 0, 0}));
  // NaN stays visible
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(inverted(log, {nan, 0, 0})[0]));
}

TEST(ColourTransform, ChannelsOfOneThatDoesNotMixThem) {
  ColourTransform transform = of_kind(Kind::log, 4, 2, 3);
  transform.weights = {1, 2, 3, 4};
  const std::array<std::size_t, 2> channels{3, 1};
  const ColourTransform part = transform.select(channels);
  EXPECT_EQ(part.weights, (std::vector<double>{4, 2}));
  const Texel whole = inverted(transform, {0.5, 0.75, 1, 2});
  EXPECT_EQ(inverted(part, {2, 0.75}), (Texel{whole[3], whole[1]}));
}

TEST(ColourTransform, TextReadsBackExactly) {
  EXPECT_EQ(to_text({}), "none");
  EXPECT_TRUE(colour_transform_from_text("none", 5, "f").is_identity());
  for (const Kind kind : {Kind::none, Kind::log, Kind::ycrcb, Kind::logluv, Kind::decorrelated}) {
    for (const bool weighted : {false, true}) {
      if (kind == Kind::none && !weighted) continue;
      ColourTransform transform;
      transform.kind = kind;
      if (!transform.is_linear()) transform.scale = 1.0 / 3, transform.largest = 65504 + 1.0 / 7;
      if (kind == Kind::decorrelated) transform.axes = random_orthonormal(3, 3, 9);
      if (weighted) transform.weights = {1, 1.0 / 3, 1e-6};
      EXPECT_EQ(colour_transform_from_text(to_text(transform), 3, "f"), transform)
          << to_text(transform);
    }
  }
}

TEST(ColourTransform, HostileTextIsRefused) {
  const struct {
    const char* text;
    std::size_t channels;
    const char* says;
  } cases[] = {
      {"", 3, "JSON"},
      {"log", 3, "JSON"},
      {"[]", 3, "object"},
      {"{}", 3, "name"},
      {R"({"name":7})", 3, "name"},
      {R"({"name":"hsv"})", 3, "hsv"},
      {R"({"name":"none"})", 3, "weights"},
      {R"({"name":"log"})", 3, "scale"},
      {R"({"name":"log","scale":1})", 3, "largest"},
      {R"({"name":"log","scale":"1","largest":1})", 3, "scale"},
      {R"({"name":"log","scale":0,"largest":1})", 3, "scale"},
      {R"({"name":"log","scale":-1,"largest":1})", 3, "scale"},
      {R"({"name":"log","scale":1e-300,"largest":1})", 3, "scale"},
      {R"({"name":"log","scale":1e-20,"largest":1e30})", 3, "scale"},
      {R"({"name":"log","scale":1,"largest":1e31})", 3, "largest"},
      {R"({"name":"log","scale":1,"largest":-1})", 3, "largest"},
      {R"({"name":"log","scale":1,"scale":1,"largest":1})", 3, "twice"},
      {R"({"name":"log","scale":1,"largest":1,"axes":[]})", 3, "axes"},
      {R"({"name":"ycrcb","scale":1})", 3, "scale"},
      {R"({"name":"ycrcb"})", 1, "three channels"},
      {R"({"name":"logluv","scale":1,"largest":1})", 4, "three channels"},
      {R"({"name":"ycrcb","weights":[1,1]})", 3, "2 channel weights"},
      {R"({"name":"ycrcb","weights":[1,0,1]})", 3, "weight 0"},
      {R"({"name":"ycrcb","weights":[1,1e300,1]})", 3, "weight"},
      {R"({"name":"ycrcb","weights":[1,null,1]})", 3, "weights"},
      {R"({"name":"ycrcb","weights":1})", 3, "weights"},
      {R"({"name":"ycrcb","more":1})", 3, "more"},
      {R"({"name":"decorrelated"})", 1, "axes"},
      {R"({"name":"decorrelated","axes":[1,0,0]})", 2, "axes"},
      {R"({"name":"decorrelated","axes":[1,0,1,0]})", 2, "orthonormal"},
      {R"({"name":"decorrelated","axes":[1e200,0,0,1e200]})", 2, "orthonormal"},
  };
  for (const auto& hostile : cases) {
    SCOPED_TRACE(hostile.text);
    expect_error(ErrorKind::input, {"m.weft", hostile.says}, [&] {
      colour_transform_from_text(hostile.text, hostile.channels, "m.weft: colour_transform");
    });
  }
}

}  // namespace
}  // namespace weft::test
