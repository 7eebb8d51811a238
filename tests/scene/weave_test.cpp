#include "weft/scene/weave.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "weft/error.hpp"
#include "weft/scene/noise.hpp"

namespace weft::test {
namespace {

TEST(Noise, IsSmoothAndRepeats) {
  double before = value_noise(0.0, 5, 42);
  for (int i = 1; i <= 1000; ++i) {
    const double x = i * 0.005;
    const double here = value_noise(x, 5, 42);
    EXPECT_LE(std::abs(here), 1);
    // The steepest smooth step between -1 and 1 rises by 3 per cell.
    EXPECT_LE(std::abs(here - before), 3 * 0.005 + 1e-12);
    EXPECT_NEAR(here, value_noise(x - 10, 5, 42), 1e-12);
    EXPECT_NEAR(value_noise(x, 0.3, 5, 3, 42), value_noise(x + 5, -2.7, 5, 3, 42), 1e-12);
    before = here;
  }
  EXPECT_NE(value_noise(0.5, 5, 42), value_noise(0.5, 5, 43));
}

TEST(WeavePattern, InterlacesAsNamed) {
  const WeavePattern plain{1, 1, 1};
  EXPECT_NE(plain.warp_on_top(0, 0), plain.warp_on_top(0, 1));
  EXPECT_NE(plain.warp_on_top(0, 0), plain.warp_on_top(1, 0));
  // A twill's floats step by one yarn from warp to warp.
  const WeavePattern twill{2, 2, 1};
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 1; j < 8; ++j) {
      EXPECT_EQ(twill.warp_on_top(i + 1, j - 1), twill.warp_on_top(i, j));
    }
  }
}

// Which yarn is seen at the middle of every crossing is the pattern itself.
TEST(WeaveCloth, ShowsItsPattern) {
  for (const WeavePattern pattern : {WeavePattern{1, 1, 1}, WeavePattern{2, 2, 1},
                                     WeavePattern{3, 1, 1}, WeavePattern{4, 1, 2}}) {
    WeaveCloth cloth = standard_cloth(64, 64);
    cloth.pattern = pattern;
    cloth.warp_count = 2 * pattern.period();
    cloth.weft_count = pattern.period();
    const Surface surface = make_surface(cloth, 512, 256);
    validate(surface);
    for (std::size_t i = 0; i < cloth.warp_count; ++i) {
      for (std::size_t j = 0; j < cloth.weft_count; ++j) {
        const std::size_t c = (2 * i + 1) * 512 / (2 * cloth.warp_count);
        const std::size_t r = (2 * j + 1) * 256 / (2 * cloth.weft_count);
        EXPECT_EQ(surface.layers[0].colors[r * 512 + c].lobe, pattern.warp_on_top(i, j) ? 0 : 1)
            << pattern.over << "/" << pattern.under << " at " << i << " " << j;
      }
    }
  }
}

// Along the middle of a yarn that lies on top, everything is smooth: steps across the border of the
// tile are no larger than those inside it. `set` is 0 for warp, along y, and 1 for weft, along x.
void expect_no_seam(const Surface& surface, std::size_t set) {
  constexpr std::size_t yarns = 16;
  const std::size_t n = surface.rows, spacing = n / yarns;
  std::vector<double> rise(n), tint(n);
  std::vector<std::size_t> count(n);
  for (std::size_t s = 0; s < n; ++s) {
    for (std::size_t across = 0; across < n; ++across) {
      const std::size_t place = across % spacing;
      if (place < spacing * 3 / 8 || place > spacing * 5 / 8) continue;
      const std::size_t next = (s + 1) % n;
      const std::size_t a = set == 0 ? s * n + across : across * n + s;
      const std::size_t b = set == 0 ? next * n + across : across * n + next;
      const auto lobe = static_cast<float>(set);
      if (surface.layers[0].colors[a].lobe != lobe || surface.layers[0].colors[b].lobe != lobe)
        continue;
      ++count[s];
      rise[s] = std::max<double>(
          rise[s], std::abs(surface.layers[0].elevation[a] - surface.layers[0].elevation[b]));
      tint[s] = std::max<double>(tint[s], std::abs(surface.layers[0].colors[a].albedo[2] -
                                                   surface.layers[0].colors[b].albedo[2]));
    }
  }
  ASSERT_GT(count[n - 1], 0u);
  EXPECT_LE(rise[n - 1], *std::max_element(rise.begin(), rise.end() - 1)) << "set " << set;
  EXPECT_LE(tint[n - 1], *std::max_element(tint.begin(), tint.end() - 1)) << "set " << set;
}

TEST(WeaveCloth, HasNoSeam) {
  WeaveCloth cloth = standard_cloth(64, 64);
  // Grooves nearly along the yarns: a twist that did not meet itself would be a large step.
  cloth.warp.ply_relief = cloth.weft.ply_relief = 0.3;
  cloth.warp.twists = 0.09;
  cloth.weft.twists = -0.09;
  const Surface surface = make_surface(cloth, 1024, 1024);
  expect_no_seam(surface, 0);
  expect_no_seam(surface, 1);
}

TEST(WeaveCloth, DependsOnItsSeedOnly) {
  WeaveCloth cloth = standard_cloth(64, 64);
  const Surface first = make_surface(cloth, 128, 128);
  const Surface again = make_surface(cloth, 128, 128);
  EXPECT_EQ(first.layers[0].elevation, again.layers[0].elevation);
  cloth.seed = 2;
  EXPECT_NE(first.layers[0].elevation, make_surface(cloth, 128, 128).layers[0].elevation);
}

TEST(WeaveCloth, FollowsTheAspectRatio) {
  EXPECT_EQ(standard_cloth(128, 128).warp_count, 16u);
  EXPECT_EQ(standard_cloth(256, 128).warp_count, 32u);
  EXPECT_EQ(standard_cloth(256, 128).weft_count, 16u);
  EXPECT_EQ(standard_cloth(1, 1).warp_count, 16u);
  for (const auto& [width, height] :
       {std::pair<std::size_t, std::size_t>{7, 5}, {33, 17}, {1, 16384}, {16384, 1}, {100, 99}}) {
    validate(standard_cloth(width, height));
  }
}

TEST(WeaveCloth, ResolutionIsAPowerOfTwoWithinBounds) {
  EXPECT_EQ(surface_resolution(1), 256u);
  EXPECT_EQ(surface_resolution(33), 512u);
  EXPECT_EQ(surface_resolution(128), 1024u);
  EXPECT_EQ(surface_resolution(16384), 2048u);
}

TEST(WeaveCloth, ExtremesAreSurfaces) {
  // Level, thin, wide, coarse, and yarns without any relief.
  std::vector<WeaveCloth> cloths(4, standard_cloth(64, 64));
  cloths[0].warp.thickness = cloths[0].weft.thickness = 0;
  cloths[1].warp.width = 0.05;
  cloths[1].weft.width = 1.9;
  cloths[2].warp.plies = 1;
  cloths[2].warp.twists = 0;
  cloths[2].weft.twists = 64;
  cloths[3].warp.crimp = cloths[3].weft.crimp = 0;
  for (const WeaveCloth& cloth : cloths) {
    validate(make_surface(cloth, 64, 64));
    validate(make_surface(cloth, 1, 1));
    validate(make_surface(cloth, 1, 64));
  }
}

TEST(WeaveCloth, RefusesWhatMakesNoCloth) {
  struct Case {
    std::function<void(WeaveCloth&)> spoil;
    std::string field;
  };
  const std::vector<Case> cases = {
      {[](WeaveCloth& c) { c.pattern.over = 0; }, "pattern.over is 0"},
      {[](WeaveCloth& c) { c.pattern.under = 1000; }, "pattern.under is 1000"},
      {[](WeaveCloth& c) { c.pattern.step = 4; }, "pattern.step is 4"},
      {[](WeaveCloth& c) { c.warp_count = 0; }, "warp_count is 0"},
      {[](WeaveCloth& c) { c.weft_count = 15; }, "weft_count is 15"},
      {[](WeaveCloth& c) { c.warp.width = 0; }, "warp.width is 0"},
      {[](WeaveCloth& c) { c.weft.thickness = -1; }, "weft.thickness is -1"},
      {[](WeaveCloth& c) { c.weft.crimp = std::nan(""); }, "weft.crimp is nan"},
      {[](WeaveCloth& c) { c.warp.plies = 0; }, "warp.plies is 0"},
      {[](WeaveCloth& c) { c.warp.pinch = 1; }, "warp.pinch is 1"},
      {[](WeaveCloth& c) { c.warp.twists = 1e300; }, "warp.twists"},
      {[](WeaveCloth& c) { c.warp.color[2] = 2; }, "warp.color is 2"},
      {[](WeaveCloth& c) { c.backing[0] = -1; }, "backing is -1"},
      {[](WeaveCloth& c) { c.wander = 1; }, "wander is 1"},
      {[](WeaveCloth& c) { c.color_spread = 1; }, "color_spread is 1"},
  };
  for (const Case& wrong : cases) {
    WeaveCloth cloth = standard_cloth(64, 64);
    wrong.spoil(cloth);
    try {
      make_surface(cloth, 64, 64);
      ADD_FAILURE() << "taken: " << wrong.field;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_NE(std::string(error.what()).find(wrong.field), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace weft::test
