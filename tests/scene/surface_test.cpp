#include "weft/scene/surface.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "weft/error.hpp"

namespace weft::test {
namespace {

TEST(Surface, NormalsOfASlopeThatRepeats) {
  // z = sin(2 pi x / 4) + 2 cos(2 pi y / 8)
  constexpr double pi = 3.14159265358979;
  Surface surface = make_flat_surface(256, 512, 4, 8);
  for (std::size_t r = 0; r < 512; ++r) {
    for (std::size_t c = 0; c < 256; ++c) {
      const double x = static_cast<double>(c) / 64, y = static_cast<double>(r) / 64;
      surface.layers[0].elevation[r * 256 + c] =
          static_cast<float>(std::sin(2 * pi * x / 4) + 2 * std::cos(2 * pi * y / 8));
    }
  }
  finish_surface(surface);
  validate(surface);
  EXPECT_NEAR(surface.highest, 3, 1e-3);
  EXPECT_NEAR(surface.lowest, -3, 1e-3);
  EXPECT_NEAR(surface.reference, 0, 1e-6);
  for (std::size_t r = 0; r < 512; r += 37) {
    for (std::size_t c = 0; c < 256; c += 15) {
      const double x = static_cast<double>(c) / 64, y = static_cast<double>(r) / 64;
      const double sx = pi / 2 * std::cos(pi / 2 * x), sy = -pi / 2 * std::sin(pi / 4 * y);
      const double length = std::sqrt(1 + sx * sx + sy * sy);
      // Central differences are off by step^2/6 times the third derivative, (pi/2)^3: 1.6e-4; and
      // by the rounding of elevations, 2 x 2^-23 per two cells of 1/64: 8e-6.
      const SurfaceSample& sample = surface.layers[0].samples[r * 256 + c];
      EXPECT_NEAR(sample.normal_x, -sx / length, 2e-4);
      EXPECT_NEAR(sample.normal_y, -sy / length, 2e-4);
    }
  }
}

TEST(Surface, ConstantElevationStaysWithinItsBounds) {
  for (const float z : {0.1f, -7.3f, 1e-20f}) {
    Surface surface = make_flat_surface(64, 32, 3, 2);
    for (float& value : surface.layers[0].elevation) value = z;
    finish_surface(surface);
    EXPECT_EQ(surface.reference, z);
    validate(surface);
  }
}

// A column is covered where elevation and underside, or the floor, leave room for material.
TEST(Surface, BoundsAreThoseOfTheMaterial) {
  Surface surface = make_flat_surface(4, 2, 4, 2, 2);
  SurfaceLayer& net = surface.layers[0];
  net.elevation = {1, 1, -1, -1, 1, 3, -1, -1};
  net.underside = {0, 0.5f, 2, 2, 1, 2, 2, 2};
  // The second layer is below, or not at all.
  surface.layers[1].elevation.assign(8, -1);
  surface.layers[1].underside.assign(8, 0);
  finish_surface(surface);
  validate(surface);
  EXPECT_TRUE(may_have_holes(surface));
  EXPECT_EQ(surface.lowest, 0);
  EXPECT_EQ(surface.highest, 3);
  EXPECT_EQ(surface.reference, 1.5f);  // of four covered columns

  surface.layers[1].underside.clear();
  finish_surface(surface);
  validate(surface);
  EXPECT_FALSE(may_have_holes(surface));
  EXPECT_EQ(surface.lowest, -1);
  EXPECT_EQ(surface.highest, 3);
  EXPECT_EQ(surface.reference, 0.25f);  // of eight

  surface.layers.pop_back();
  net.elevation.assign(8, -1);
  net.underside.assign(8, 1);
  EXPECT_THROW(finish_surface(surface), Error);
}

TEST(Surface, RefusesWhatIsNone) {
  struct Case {
    std::function<void(Surface&)> spoil;
    std::string field;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Case> cases = {
      {[](Surface& s) { s.columns = 12; }, "columns is 12"},
      {[](Surface& s) { s.rows = 0; }, "rows is 0"},
      {[](Surface& s) { s.rows = 16384; }, "rows is 16384"},
      {[](Surface& s) { s.layers[0].elevation.pop_back(); }, "elevation has 127"},
      {[](Surface& s) { s.layers[0].samples.pop_back(); }, "samples has 127"},
      {[](Surface& s) { s.layers[0].colors.clear(); }, "colors has 0"},
      {[](Surface& s) { s.width = -1; }, "width is -1"},
      {[](Surface& s) { s.depth = std::nan(""); }, "depth is nan"},
      {[nan](Surface& s) { s.layers[0].elevation[5] = nan; }, "elevation 5"},
      {[](Surface& s) { s.layers[0].elevation[5] = 1; }, "elevation 5 is 1"},
      {[](Surface& s) { s.layers.clear(); }, "layers is 0"},
      {[](Surface& s) { s.layers.resize(9); }, "layers is 9"},
      {[](Surface& s) { s.layers.resize(2); }, "elevation of layer 1 has 0"},
      {[](Surface& s) { s.layers[0].underside.resize(9); }, "underside has 9"},
      {[nan](Surface& s) { s.layers[0].underside.assign(128, nan); }, "underside 0 is nan"},
      {[](Surface& s) { s.layers[0].underside.assign(128, 1); }, "underside 0 is 1"},
      {[](Surface& s) { s.layers[0].underside.assign(128, -1); }, "underside 0 is -1"},
      {[nan](Surface& s) { s.reference = nan; }, "reference"},
      {[](Surface& s) { s.reference = 1; }, "reference elevation 1"},
      {[](Surface& s) { s.highest = std::numeric_limits<float>::infinity(); }, "inf"},
      {[](Surface& s) { s.highest = 1e6f; }, "cells"},
      {[nan](Surface& s) { s.layers[0].samples[7].normal_x = nan; }, "normal 7"},
      {[](Surface& s) { s.layers[0].samples[7].fibre_x = 3; }, "fibre 7"},
      {[](Surface& s) { s.layers[0].colors[9].albedo[1] = 1.5f; }, "albedo 9 is 1.5"},
      {[](Surface& s) { s.layers[0].colors[9].lobe = 1; }, "lobe 9"},
      {[](Surface& s) {
         s.lobes.resize(3);
         s.layers[0].colors[9].lobe = 0.5f;
       },
       "lobe 9 is 0.5"},
      {[](Surface& s) { s.lobes.clear(); }, "lobes"},
      {[](Surface& s) { s.lobes[0].alpha_across = 0; }, "alpha_across of lobe 0 is 0"},
      {[nan](Surface& s) { s.lobes[0].f0[2] = nan; }, "f0 of lobe 0"},
  };
  for (const Case& wrong : cases) {
    Surface surface = make_flat_surface(16, 8, 2, 1);
    validate(surface);
    wrong.spoil(surface);
    try {
      validate(surface);
      ADD_FAILURE() << "taken: " << wrong.field;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_NE(std::string(error.what()).find(wrong.field), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace weft::test
