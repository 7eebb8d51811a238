// What the renderer must show, on scenes whose pictures are known: reference and device alike.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>

#include "render/render_support.hpp"
#include "support/matchers.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

constexpr double pi = std::numbers::pi;

// The same scene by both.
struct Renders {
  std::vector<double> device, reference;
};
Renders render_both(const Surface& surface, const BtfInfo& info,
                    const SurfaceRenderOptions& options) {
  Device device("auto");
  return {render_on_device(device, surface, info, options),
          render_on_reference(surface, info, options)};
}

TEST(RenderSurfaceScene, LambertianPlaneGivesAlbedoOverPiCosine) {
  const BtfInfo info = render_info(3, 2, ubo81_directions(), ubo81_directions());
  const Renders renders = render_both(lambertian_plane(0.7f), info, render_options(3));
  std::vector<double> expected;
  for (std::size_t image = 0; image < info.shape.images(); ++image) {
    const Direction& light = info.light_directions[image % 81];
    const double z = light[2], length = std::hypot<double, double, double>(light[0], light[1], z);
    expected.insert(expected.end(), info.shape.image_values(), 0.7f / pi * z / length);
  }
  // Both normalise the direction in double; the device then rounds it, the product with 1/pi, the
  // cosine, three sums and the mean: ten roundings at most. The reference rounds its output once.
  EXPECT_TRUE(all_near(renders.reference, expected,
                       [&](std::size_t i) { return 1.01 * float_roundoff * expected[i]; }));
  EXPECT_TRUE(all_near(renders.device, expected,
                       [&](std::size_t i) { return 10 * float_roundoff * expected[i]; }));
}

// For a level plane, T[v, l] / cos(l) is the BRDF, which is the same for (l, v).
TEST(RenderSurfaceScene, LevelPlaneIsReciprocal) {
  Surface surface = lambertian_plane(0.3f);
  surface.lobes = {{{0.04f, 0.4f, 1.0f}, 1, 0.2f, 0.6f}};
  const std::vector<Direction> directions = ubo81_directions();
  const BtfInfo info = render_info(1, 1, directions, directions);
  const Renders renders = render_both(surface, info, render_options(1));
  for (const auto& [values, roundings] :
       {std::pair{&renders.reference, 4.0}, {&renders.device, 128.0}}) {
    double largest = 0;
    for (std::size_t v = 0; v < 81; ++v) {
      for (std::size_t l = 0; l < v; ++l) {
        for (std::size_t c = 0; c < 3; ++c) {
          const double there = (*values)[(v * 81 + l) * 3 + c] / directions[l][2];
          const double back = (*values)[(l * 81 + v) * 3 + c] / directions[v][2];
          EXPECT_NEAR(there, back, roundings * float_roundoff * std::max(there, back));
          largest = std::max(largest, there);
        }
      }
    }
    EXPECT_GT(largest, 1);  // gloss was there
  }
}

// Parallax: seen from 45 degrees, a point of height 1 appears 1 nearer to the viewer's far side. A
// plateau over [2, 4) seen from +x covers the texels [1, 3) of the floor, and its wall [3, 4).
void expect_parallax(bool along_x, double phi) {
  const std::size_t n = 64;
  const BtfInfo info =
      render_info(along_x ? n : 1, along_x ? 1 : n, {direction_from_degrees(45, phi)}, {{0, 0, 1}});
  const Renders renders = render_both(plateau(along_x), info, render_options(1));
  const bool from_above = phi < 180;  // +x, or +y
  for (const std::vector<double>* values : {&renders.reference, &renders.device}) {
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t texel = along_x ? i : n - 1 - i;  // row 0 is the top
      const double low = 8.0 * static_cast<double>(i) / n, high = low + 8.0 / n;
      const double red = (*values)[3 * texel], green = (*values)[3 * texel + 1];
      const double first = from_above ? 1 : 3;
      // Walls are 1/32 wide, and a texel may straddle an edge.
      const double margin = 1.0 / 16;
      if (low > first + margin && high < first + 2 - margin) {
        EXPECT_NEAR(red, 1 / pi, 1e-6) << i;
        EXPECT_EQ(green, 0) << i;
      }
      if (high < 1 - margin || low > 5 + margin || (from_above && low > 4 + margin) ||
          (!from_above && high < 2 - margin)) {
        EXPECT_EQ(red, 0) << i;
        EXPECT_NEAR(green, 1 / pi, 1e-6) << i;
      }
      // The wall that faces the viewer: neither the top's colour alone nor the floor's.
      const double wall = from_above ? 3 : 2;
      if (low > wall + margin && high < wall + 1 - margin) {
        EXPECT_GT(red, 0.01) << i;
        EXPECT_GT(green, 0.01) << i;
      }
    }
  }
}
TEST(RenderSurfaceScene, ParallaxAlongX) {
  expect_parallax(true, 0);
  expect_parallax(true, 180);
}
TEST(RenderSurfaceScene, ParallaxAlongY) {
  expect_parallax(false, 90);
  expect_parallax(false, 270);
}

// Shadows: under a light from +x at 45 degrees the plateau's shadow falls on [1, 2).
void expect_shadow(bool along_x, double phi) {
  const std::size_t n = 64;
  const BtfInfo info = render_info(along_x ? n : 1, along_x ? 1 : n, {{0, 0, 1}},
                                   {direction_from_degrees(45, phi), {0, 0, 1}});
  const Renders renders = render_both(plateau(along_x), info, render_options(1));
  const double begin = phi < 180 ? 1 : 4;
  const double lit = std::sqrt(0.5) / pi;
  for (const std::vector<double>* values : {&renders.reference, &renders.device}) {
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t texel = along_x ? i : n - 1 - i;
      const double low = 8.0 * static_cast<double>(i) / n, high = low + 8.0 / n;
      const double sum = (*values)[3 * texel] + (*values)[3 * texel + 1];
      const double margin = 1.0 / 16;
      if (low > begin + margin && high < begin + 1 - margin) {
        EXPECT_EQ(sum, 0) << i;
      }
      if (high < begin - margin || low > begin + 1 + margin) {
        EXPECT_NEAR(sum, lit, 1e-6) << i;
      }
      // Under the zenith there is no shadow.
      EXPECT_NEAR((*values)[3 * (n + texel)] + (*values)[3 * (n + texel) + 1], 1 / pi, 1e-6);
    }
  }
}
TEST(RenderSurfaceScene, ShadowAlongX) {
  expect_shadow(true, 0);
  expect_shadow(true, 180);
}
TEST(RenderSurfaceScene, ShadowAlongY) {
  expect_shadow(false, 90);
  expect_shadow(false, 270);
}

// A slab that hangs in the air, seen and lit from 45 degrees. (x, y): towards +x or +y where
// phi < 180. Seen from there it covers [2, 4.5) of the plane of its top, and nothing else is met.
void expect_slab(bool along_x, double phi) {
  const std::size_t n = 64;
  const Direction slanted = direction_from_degrees(45, phi);
  BtfInfo info = render_info(along_x ? n : 1, along_x ? 1 : n, {slanted, {0, 0, 1}}, {{0, 0, 1}});
  Device device("auto");
  const Surface surface = slab(along_x, false);
  const Renders renders = render_both(surface, info, render_options(1));
  BtfInfo masked[2] = {info, info};
  render_surface_mask(device, surface, render_options(1), masked[0]);
  render_surface_mask_reference(surface, render_options(1), masked[1]);
  const bool from_above = phi < 180;  // +x, or +y
  for (const bool by_device : {true, false}) {
    const std::vector<double>& values = by_device ? renders.device : renders.reference;
    const BtfInfo& mask = masked[by_device ? 0 : 1];
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t texel = along_x ? i : n - 1 - i;  // row 0 is the top
      const double low = 8.0 * static_cast<double>(i) / n, high = low + 8.0 / n;
      const double margin = 1.0 / 16;
      const double first = from_above ? 2 : 1.5, last = from_above ? 4.5 : 4;
      if (low > first + margin && high < last - margin) {
        EXPECT_EQ(mask.mask[texel], 1) << i;
        EXPECT_GT(mask.mask_distance[texel], 0) << i;
      }
      if (high < first - margin || low > last + margin) {
        EXPECT_EQ(values[3 * texel], 0) << i;
        EXPECT_EQ(mask.mask[texel], 0) << i;
        EXPECT_LT(mask.mask_distance[texel], 0) << i;
      }
      // Its top.
      if (low > 2 + margin && high < 4 - margin) {
        EXPECT_NEAR(values[3 * texel], 1 / pi, 1e-6) << i;
        EXPECT_NEAR(values[3 * (n + texel)], 1 / pi, 1e-6) << i;
        EXPECT_EQ(mask.mask[n + texel], 1);
      }
      if (high < 2 - margin || low > 4 + margin) {
        EXPECT_EQ(values[3 * (n + texel)], 0) << i;
        EXPECT_EQ(mask.mask[n + texel], 0) << i;
      }
    }
  }
}
TEST(RenderSurfaceScene, SlabHangsInTheAir) {
  expect_slab(true, 0);
  expect_slab(true, 180);
  expect_slab(false, 90);
  expect_slab(false, 270);
}

// Above a floor, its shadow is that of a slab and not of a block: under a light from +x at 45
// degrees it falls on [1, 3.5). Seen from where the light is, nothing lies in shadow.
TEST(RenderSurfaceScene, LightPassesUnderASlab) {
  for (const bool along_x : {true, false}) {
    const std::size_t n = 64;
    const double phi = along_x ? 0 : 90;
    const std::vector<Direction> lights = {direction_from_degrees(45, phi),
                                           direction_from_degrees(45, phi + 180)};
    const BtfInfo info =
        render_info(along_x ? n : 1, along_x ? 1 : n, {lights[0], lights[1], {0, 0, 1}}, lights);
    const Renders renders = render_both(slab(along_x, true), info, render_options(1));
    const double lit = std::sqrt(0.5) / pi;
    for (const std::vector<double>* values : {&renders.device, &renders.reference}) {
      const auto at = [&](std::size_t view, std::size_t light, std::size_t texel, std::size_t c) {
        return (*values)[3 * ((view * 2 + light) * n + texel) + c];
      };
      std::size_t below = 0;
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t texel = along_x ? i : n - 1 - i;
        const double low = 8.0 * static_cast<double>(i) / n, high = low + 8.0 / n;
        const double margin = 1.0 / 16;
        // View and light from +x. The view ray of x meets the floor at x - 1.
        const bool edge = std::abs(low - 4.5) < 2 * margin || std::abs(low - 2) < 2 * margin;
        const bool top = low > 2 && high < 4;
        const bool side =
            low >= 4 - 2 * margin && high < 4.5 + margin;  // whose normals are of either face
        if (!edge && !side) {
          EXPECT_NEAR(at(0, 0, texel, 0), top ? lit : 0, 1e-6) << i;
          EXPECT_NEAR(at(0, 0, texel, 1), top ? 0 : lit, 1e-6) << i;
        }
        if (low > 4.5 + margin && high < 5 - margin) ++below;  // floor at [3.5, 4), below the slab
        // From above, the light from +x: shadow on [1, 2) of what is seen; from -x: on [4, 5).
        const auto expect_shadow = [&](std::size_t light, double from, double to) {
          if (low > from + margin && high < to - margin) {
            EXPECT_EQ(at(2, light, texel, 1), 0) << i;
          }
          const bool clear = high < from - margin || low > to + margin;
          const bool on_floor = high < 2 - margin || low > 4 + margin;
          if (clear && on_floor) {
            EXPECT_NEAR(at(2, light, texel, 1), lit, 1e-6) << i;
          }
        };
        expect_shadow(0, 1, 2);
        expect_shadow(1, 4, 5);
      }
      EXPECT_GT(below, 1u);
    }
  }
}

// A level plane shows itself nothing.
TEST(RenderSurfaceScene, LevelPlaneHasNoBounce) {
  const BtfInfo info = render_info(5, 3, even_directions(5), even_directions(9));
  SurfaceRenderOptions options = render_options(4);
  const Renders direct = render_both(lambertian_plane(0.7f), info, options);
  options.bounces = 1;
  const Renders both = render_both(lambertian_plane(0.7f), info, options);
  EXPECT_TRUE(all_equal(both.device, direct.device));
  EXPECT_TRUE(all_equal(both.reference, direct.reference));
}

// In grooves whose walls stand at right angles, light from the zenith gives every point of a wall
// the radiance a/pi cos 45. A point at distance s from the valley sees the opposite wall, of length
// 1, within F(s) = (1 - s / sqrt(1 + s^2)) / 2 of its hemisphere, weighted by the cosine; the mean
// over the wall is 1 - sqrt(1/2). Rays of neighbouring grooves pass over the ridges.
TEST(RenderSurfaceScene, GroovesLightThemselves) {
  const float albedo = 0.6f;
  const double form_factor = 1 - std::sqrt(0.5);
  Device device("auto");
  struct Case {
    std::size_t columns, texels, samples;
    bool by_device;
  };
  for (const Case& c : {Case{1024, 64, 256, true}, {256, 16, 256, false}}) {
    const BtfInfo info = render_info(c.texels, 1, {{0, 0, 1}}, {{0, 0, 1}});
    SurfaceRenderOptions options = render_options(c.samples);
    const Surface surface = grooves(c.columns, albedo);
    const auto mean_of = [&](std::size_t bounces) {
      options.bounces = bounces;
      const std::vector<double> values = c.by_device
                                             ? render_on_device(device, surface, info, options)
                                             : render_on_reference(surface, info, options);
      double red = 0, green = 0;
      for (std::size_t i = 0; i < values.size(); i += 3) {
        red += values[i] / static_cast<double>(c.texels);
        green += values[i + 1] / static_cast<double>(c.texels);
      }
      return std::array{red, green};
    };
    const auto direct = mean_of(0), both = mean_of(1);
    // Normals are rounded off over a cell at each end of the two walls.
    const double ends = 4 / (0.5 * static_cast<double>(c.columns));
    EXPECT_NEAR(direct[0], albedo / pi * std::sqrt(0.5), ends * albedo / pi);
    // Of each sample, the chance of meeting the other wall is F: three standard deviations of
    // independent ones, and these are more even.
    const double rays = static_cast<double>(c.texels * c.samples);
    const double tolerance = 3 * std::sqrt(form_factor * (1 - form_factor) / rays) + ends;
    const double radiance = albedo / pi * std::sqrt(0.5);
    EXPECT_NEAR((both[0] - direct[0]) / (albedo * radiance), form_factor, tolerance);
    EXPECT_NEAR((both[1] - direct[1]) / (0.25 * albedo * radiance), form_factor, tolerance);
  }
}

// The reference shows the same at points that are whole periods apart.
TEST(RenderSurfaceReference, Repeats) {
  const Surface surface = small_cloth();
  const Direction view = direction_from_degrees(60, 70), light = direction_from_degrees(45, 200);
  Random random(5);
  for (int i = 0; i < 500; ++i) {
    // Multiples of 2^-20, which adding periods leaves as they are.
    const double x = std::floor(random.uniform(0, 64) * 0x1p20) * 0x1p-20;
    const double y = std::floor(random.uniform(0, 64) * 0x1p20) * 0x1p-20;
    const TracedSample here = trace_sample(surface, view, light, x, y);
    const TracedSample there = trace_sample(surface, view, light, x + 64, y - 3 * 64);
    if (here.margin < 1e-9) continue;
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(here.radiance[c], there.radiance[c], 1e-7);
  }
}

// On the device: a tile twice as long with the same content shows the same bits twice over its
// first half, although rays leave the one through its border and the other through its middle.
TEST(RenderSurfaceScene, WrapsAtTheBorder) {
  const Surface single = small_cloth();
  Surface twice = make_flat_surface(128, 64, 2 * single.width, single.depth);
  for (std::size_t r = 0; r < 64; ++r) {
    for (std::size_t c = 0; c < 128; ++c) {
      twice.layers[0].elevation[r * 128 + c] = single.layers[0].elevation[r * 64 + c % 64];
      twice.layers[0].samples[r * 128 + c] = single.layers[0].samples[r * 64 + c % 64];
      twice.layers[0].colors[r * 128 + c] = single.layers[0].colors[r * 64 + c % 64];
    }
  }
  twice.lobes = single.lobes;
  twice.lowest = single.lowest;
  twice.highest = single.highest;
  twice.reference = single.reference;
  const std::vector<Direction> views = {direction_from_degrees(70, 0),
                                        direction_from_degrees(70, 180)};
  const std::vector<Direction> lights = {direction_from_degrees(75, 10),
                                         direction_from_degrees(75, 190)};
  // One row, so that texels keep their numbers.
  const Renders one = render_both(single, render_info(16, 1, views, lights), render_options(4));
  const Renders two = render_both(twice, render_info(32, 1, views, lights), render_options(4));
  for (std::size_t image = 0; image < 4; ++image) {
    for (std::size_t i = 0; i < 48; ++i) {
      EXPECT_EQ(one.device[image * 48 + i], two.device[image * 96 + i]) << image << " " << i;
      EXPECT_EQ(one.reference[image * 48 + i], two.reference[image * 96 + i]);
    }
  }
}

TEST(RenderSurfaceReference, SamplesFillTheTexel) {
  std::set<std::pair<double, double>> offsets;
  double sum_u = 0, sum_v = 0;
  std::array<int, 16> cells{};
  constexpr std::size_t count = 1024;
  for (std::size_t s = 0; s < count; ++s) {
    const auto [u, v] = sample_offset(9, 3, 77, s);
    EXPECT_TRUE(u >= 0 && u < 1 && v >= 0 && v < 1);
    EXPECT_EQ(u * 0x1p24, std::floor(u * 0x1p24));
    offsets.insert({u, v});
    sum_u += u / count;
    sum_v += v / count;
    ++cells[static_cast<std::size_t>(u * 4) + 4 * static_cast<std::size_t>(v * 4)];
  }
  EXPECT_EQ(offsets.size(), count);
  EXPECT_NEAR(sum_u, 0.5, 0.01);
  EXPECT_NEAR(sum_v, 0.5, 0.01);
  // Far more even than random numbers, whose counts scatter by 8.
  for (const int cell : cells) EXPECT_NEAR(cell, 64, 6);
  // Seeds, views and texels have jitter of their own.
  EXPECT_NE(sample_offset(9, 3, 77, 0), sample_offset(8, 3, 77, 0));
  EXPECT_NE(sample_offset(9, 3, 77, 0), sample_offset(9 + (1ull << 32), 3, 77, 0));
  EXPECT_NE(sample_offset(9, 3, 77, 0), sample_offset(9, 4, 77, 0));
  EXPECT_NE(sample_offset(9, 3, 77, 0), sample_offset(9, 3, 78, 0));
  EXPECT_NE(sample_offset(9, 3, 77, 0), sample_offset(9, 3, 77 + (1ull << 32), 0));
}

TEST(RenderSurfaceReference, RefusesWhatItCannotRender) {
  const Surface surface = lambertian_plane(0.5f);
  const BtfInfo good = render_info(4, 4, {{0, 0, 1}}, {{0, 0, 1}});
  const auto expect_refused = [&](const BtfInfo& info, const SurfaceRenderOptions& options,
                                  const std::string& field) {
    Device device("auto");
    for (int by_device = 0; by_device < 2; ++by_device) {
      MemorySink sink(info);
      try {
        if (by_device) {
          render_surface(device, surface, options, sink);
        } else {
          render_surface_reference(surface, options, sink);
        }
        ADD_FAILURE() << "taken: " << field;
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::input);
        EXPECT_NE(std::string(error.what()).find(field), std::string::npos) << error.what();
      }
    }
  };
  BtfInfo info = good;
  info.shape.channels = 1;
  expect_refused(info, render_options(1), "channels is 1");
  info = good;
  info.encoding = Encoding::srgb;
  expect_refused(info, render_options(1), "encoding linear, not srgb");
  info = good;
  info.quantity = Quantity::brdf;
  expect_refused(info, render_options(1), "quantity is brdf");
  info = good;
  info.layout = Layout::paired;
  expect_refused(info, render_options(1), "layout is paired");
  info = good;
  info.view_directions[0] = {1, 0, 0};
  expect_refused(info, render_options(1), "view direction 0");
  info = good;
  info.light_directions[0] = {0, 0, -1};
  expect_refused(info, render_options(1), "light direction 0");
  expect_refused(good, render_options(0), "samples is 0");
  expect_refused(good, render_options(65537), "samples is 65537");
  SurfaceRenderOptions options = render_options(1);
  options.bounces = 2;
  expect_refused(good, options, "bounces is 2");
}

}  // namespace
}  // namespace weft::test
