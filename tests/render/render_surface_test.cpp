// The kernels of render_surface.cl against the double reference, and what must not change their
// bits.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "render/render_support.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "weft/tensor/half.hpp"

namespace weft::test {
namespace {

// Bound on the error of a float position, in cells: x = (column + u) cells + start + k step is made
// of eight rounded numbers, none larger than the tile and the length of a march together.
double position_error(const Surface& surface, const BtfInfo& info) {
  double march = 0;
  for (const Direction& view : info.view_directions) {
    const ViewMarch m = march_of_view(surface, view);
    march = std::max(march, static_cast<double>(m.steps));
  }
  for (const Direction& light : info.light_directions) {
    const StepMarch m = march_along(surface, normalized({light[0], light[1], light[2]}));
    march = std::max(march, (surface.highest - surface.lowest) / m.step_z);
  }
  const auto side = static_cast<double>(std::max(surface.columns, surface.rows));
  return 8 * float_roundoff * (side + march);
}

// Steepest step between neighbouring samples.
double steepest(const Surface& surface) {
  double largest = 0;
  for (std::size_t r = 0; r < surface.rows; ++r) {
    for (std::size_t c = 0; c < surface.columns; ++c) {
      const double z = surface.layers[0].elevation[r * surface.columns + c];
      const double right =
          surface.layers[0].elevation[r * surface.columns + (c + 1) % surface.columns];
      const double above =
          surface.layers[0].elevation[(r + 1) % surface.rows * surface.columns + c];
      largest = std::max({largest, std::abs(z - right), std::abs(z - above)});
    }
  }
  return largest;
}

// Rounding of the shading itself: its quantities are of the order of 1 + value, some two hundred
// operations in all, of which the fourth power of the spread multiplies errors the most.
double shading_error(double value) {
  return 512 * float_roundoff * (1 + value);
}

// What the device may show for a texel of one sample: any value that the reference shows within
// `error` of the sample's position, and, at an edge, anything if a comparison on the way was
// decided by less than the elevations' rounding.
struct Allowed {
  std::array<double, 3> low, high;
  double margin;
};

Allowed allowed_at(const Surface& surface, const Direction& view, const Direction& light, double x,
                   double y, double error) {
  Allowed allowed;
  allowed.low.fill(std::numeric_limits<double>::infinity());
  allowed.high.fill(0);
  allowed.margin = std::numeric_limits<double>::infinity();
  for (const double dx : {-error, 0.0, error}) {
    for (const double dy : {-error, 0.0, error}) {
      const TracedSample sample = trace_sample(surface, view, light, x + dx, y + dy);
      allowed.margin = std::min(allowed.margin, sample.margin);
      for (std::size_t c = 0; c < 3; ++c) {
        allowed.low[c] = std::min(allowed.low[c], sample.radiance[c]);
        allowed.high[c] = std::max(allowed.high[c], sample.radiance[c]);
      }
    }
  }
  return allowed;
}

// Returns the share of texels that were let off by their margin.
double expect_device_matches(const Surface& surface, const BtfInfo& info) {
  Device device("auto");
  const SurfaceRenderOptions options = render_options(1, 11);
  const std::vector<double> values = render_on_device(device, surface, info, options);
  const double error = position_error(surface, info);
  const double elevation_error =
      2 * steepest(surface) * error +
      8 * float_roundoff * std::max(std::abs(surface.highest), std::abs(surface.lowest));
  const BtfShape& shape = info.shape;
  std::size_t exempt = 0, wrong = 0;
  for (std::size_t image = 0; image < shape.images(); ++image) {
    for (std::size_t texel = 0; texel < shape.texels(); ++texel) {
      const auto [u, v] = sample_offset(options.seed, image / shape.lights, texel, 0);
      const double x = (static_cast<double>(texel % shape.width) + u) *
                       static_cast<double>(surface.columns) / static_cast<double>(shape.width);
      const double y = (static_cast<double>(shape.height - texel / shape.width) - v) *
                       static_cast<double>(surface.rows) / static_cast<double>(shape.height);
      const Allowed allowed = allowed_at(surface, info.view_directions[image / shape.lights],
                                         info.light_directions[image % shape.lights], x, y, error);
      bool fits = true;
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = values[(image * shape.texels() + texel) * 3 + c];
        // The nine positions sample the interval; it may reach as far again beyond them.
        const double slack = allowed.high[c] - allowed.low[c] + shading_error(allowed.high[c]);
        fits = fits && value >= allowed.low[c] - slack && value <= allowed.high[c] + slack;
      }
      if (fits) continue;
      if (allowed.margin < elevation_error) {
        ++exempt;
        continue;
      }
      if (wrong++ == 0) {
        ADD_FAILURE() << "image " << image << " texel " << texel << ": "
                      << values[(image * shape.texels() + texel) * 3] << " is not in ["
                      << allowed.low[0] << ", " << allowed.high[0] << "], margin " << allowed.margin
                      << " against " << elevation_error;
      }
    }
  }
  EXPECT_EQ(wrong, 0u) << "of " << shape.images() * shape.texels();
  return static_cast<double>(exempt) / static_cast<double>(shape.images() * shape.texels());
}

TEST(RenderSurface, ShadingMatchesTheReference) {
  // No geometry: normals, fibres, albedos and gloss alone.
  const double exempt = expect_device_matches(
      tinted_plane(2), render_info(33, 17, even_directions(5), even_directions(19)));
  EXPECT_EQ(exempt, 0);
}

TEST(RenderSurface, ClothMatchesTheReference) {
  const double exempt = expect_device_matches(
      small_cloth(256), render_info(33, 17, even_directions(7), even_directions(13)));
  // A ray compares elevations some hundred times, each within 1e-4 of the range of being a draw:
  // one ray in a hundred may turn out differently.
  EXPECT_LT(exempt, 0.01);
}

TEST(RenderSurface, SeveralSamplesMatchTheReference) {
  Device device("auto");
  const Surface surface = small_cloth(256);
  const BtfInfo info = render_info(17, 9, even_directions(4), even_directions(9));
  const std::vector<double> values = render_on_device(device, surface, info, render_options(16));
  const std::vector<double> expected = render_on_reference(surface, info, render_options(16));
  // A sample in a hundred may be another one; the mean over all texels then moves by a hundredth of
  // itself at the very most, and most values not at all.
  double difference = 0, sum = 0;
  std::size_t far = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    difference += std::abs(values[i] - expected[i]);
    sum += expected[i];
    if (std::abs(values[i] - expected[i]) > 0.01) ++far;
  }
  EXPECT_LT(difference, 0.01 * sum);
  EXPECT_LT(static_cast<double>(far), 0.01 * static_cast<double>(values.size()));
}

TEST(RenderSurface, OtherDtypesAreTheFloatsRounded) {
  // Albedos over many magnitudes: subnormal halves, both parts of the sRGB curve, and clipping.
  Surface surface = tinted_plane(4);
  surface.lobes[0].alpha_along = surface.lobes[0].alpha_across = 0.03f;
  for (std::size_t i = 0; i < surface.layers[0].colors.size(); ++i) {
    surface.layers[0].colors[i].albedo[0] =
        static_cast<float>(std::pow(10.0, -0.05 * static_cast<double>(i)));
    surface.layers[0].samples[i].normal_x = surface.layers[0].samples[i].normal_y = 0;
  }
  surface.lobes.push_back({});
  for (std::size_t i = 0; i < surface.layers[0].colors.size(); ++i) {
    surface.layers[0].colors[i].lobe = i < surface.layers[0].colors.size() / 2 ? 0.0f : 1.0f;
  }
  Device device("auto");
  // The first pair mirrors at the normal: the highlight.
  const std::vector<Direction> views = {direction_from_degrees(30, 0),
                                        direction_from_degrees(70, 40)};
  const std::vector<Direction> lights = {direction_from_degrees(30, 180), {0, 0, 1}};
  BtfInfo info = render_info(16, 16, views, lights);
  const SurfaceRenderOptions options = render_options(1);
  const std::vector<double> floats = render_on_device(device, surface, info, options);
  EXPECT_GT(*std::max_element(floats.begin(), floats.end()), 1);

  info = render_info(16, 16, views, lights, DType::f16);
  const std::vector<double> halves = render_on_device(device, surface, info, options);
  // The same float, give or take a rounding where the build differs, then the nearest half: half a
  // unit in the last place, 2^-25 for subnormals.
  EXPECT_TRUE(all_near(halves, floats, [&](std::size_t i) {
    return floats[i] * (half_roundoff + 16 * float_roundoff) + 0x1p-25;
  }));
  std::size_t subnormal = 0;
  for (const double value : halves) subnormal += value > 0 && value < 0x1p-14;
  EXPECT_GT(subnormal, 10u);

  info = render_info(16, 16, views, lights, DType::u8);
  const std::vector<double> bytes = render_on_device(device, surface, info, options);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const double x = std::min(floats[i], 1.0);
    const double curve = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
    // The nearest of 256 levels; powr is good to 16 units in the last place.
    EXPECT_NEAR(255 * bytes[i], 255 * curve, 0.5 + 255 * 32 * float_roundoff) << floats[i];
  }
  EXPECT_TRUE(all_near(render_on_reference(surface, info, options), bytes, 1.0 / 255 + 1e-9));
}

TEST(RenderSurface, BitsDoNotDependOnTilesOrRuns) {
  Device device("auto");
  const Surface surface = small_cloth();
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const BtfInfo info = render_info(7, 5, even_directions(3), even_directions(21), dtype);
    SurfaceRenderOptions options = render_options(5);
    options.bounces = dtype == DType::f16 ? 1 : 0;
    const std::vector<double> whole = render_on_device(device, surface, info, options);
    EXPECT_TRUE(all_equal(render_on_device(device, surface, info, options), whole));
    const std::size_t image = info.image_bytes();
    for (const std::size_t bytes : {std::size_t{1}, image - 1, 3 * image, 11 * image, 17 * image}) {
      options.tile_bytes = bytes;
      EXPECT_TRUE(all_equal(render_on_device(device, surface, info, options), whole)) << bytes;
    }
    options.seed = 2;
    EXPECT_FALSE(all_equal(render_on_device(device, surface, info, options), whole));
  }
}

TEST(RenderSurface, ProgressCountsImages) {
  Device device("auto");
  const BtfInfo info = render_info(5, 3, even_directions(3), even_directions(4));
  SurfaceRenderOptions options = render_options(1);
  std::vector<std::size_t> done;
  options.progress = [&done](std::size_t images) { done.push_back(images); };
  options.tile_bytes = 2 * info.image_bytes();
  render_on_device(device, lambertian_plane(0.5f), info, options);
  EXPECT_EQ(done, (std::vector<std::size_t>{2, 4, 6, 8, 10, 12}));
}

// Sharp lobes, walls of one cell and grazing directions: finite, and not negative.
TEST(RenderSurface, ExtremesStayFinite) {
  Surface surface = make_flat_surface(32, 32, 1, 1);
  Random random(6);
  for (std::size_t i = 0; i < 1024; ++i) {
    surface.layers[0].elevation[i] = static_cast<float>(random.uniform(-1, 1));
    surface.layers[0].colors[i].lobe = static_cast<float>(random.index(3));
    surface.layers[0].colors[i].albedo = {1, 0, 0.5f};
    const double angle = random.uniform(0, 6.28);
    surface.layers[0].samples[i].fibre_x = static_cast<float>(std::cos(angle));
    surface.layers[0].samples[i].fibre_y = static_cast<float>(std::sin(angle));
  }
  finish_surface(surface);
  surface.lobes = {
      {{1, 1, 1}, 1, 1e-3f, 1e-3f}, {{0, 0, 0}, 1, 1e-3f, 1}, {{0, 0, 0}, 0, 1, 1e-3f}};
  std::vector<Direction> directions = even_directions(9);
  for (const double phi : {0.0, 77.0, 180.0, 300.0}) {
    directions.push_back(direction_from_degrees(89.4, phi));
  }
  // The same as a sheet that is torn to shreds.
  Surface shreds = surface;
  shreds.layers[0].underside.resize(1024);
  for (float& z : shreds.layers[0].underside) z = static_cast<float>(random.uniform(-1, 1));
  shreds.lowest = -1;
  shreds.highest = 1;
  Device device("auto");
  for (const Surface& scene : {surface, shreds}) {
    for (const DType dtype : {DType::f32, DType::f16}) {
      const BtfInfo info = render_info(9, 9, directions, directions, dtype);
      SurfaceRenderOptions options = render_options(2);
      options.bounces = dtype == DType::f32 ? 1 : 0;
      for (const double value : render_on_device(device, scene, info, options)) {
        ASSERT_TRUE(std::isfinite(value));
        ASSERT_GE(value, 0);
      }
      for (const double value : render_on_reference(scene, info, options)) {
        ASSERT_TRUE(std::isfinite(value) && value >= 0);
      }
    }
  }
}

// A ray of a bounce begins and ends where rounding puts it, and what it meets may be far away: most
// samples agree to their rounding, and the few others must not move the mean.
TEST(RenderSurface, BouncesMatchTheReference) {
  Device device("auto");
  const BtfInfo info = render_info(17, 9, even_directions(4), even_directions(9));
  for (const Surface& surface : {small_cloth(128), net(64), net(64, true)}) {
    SurfaceRenderOptions options = render_options(1);
    const std::vector<double> direct = render_on_device(device, surface, info, options);
    options.bounces = 1;
    const std::vector<double> values = render_on_device(device, surface, info, options);
    const std::vector<double> expected = render_on_reference(surface, info, options);
    double difference = 0, sum = 0, added = 0;
    std::size_t far = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_GE(values[i], direct[i] * (1 - 4 * float_roundoff));
      // At most 1/pi comes by way of another point.
      EXPECT_LE(values[i], (direct[i] + 0.3183099) * (1 + 4 * float_roundoff));
      difference += std::abs(values[i] - expected[i]);
      sum += expected[i];
      added += values[i] - direct[i];
      if (std::abs(values[i] - expected[i]) > 1e-3) ++far;
    }
    EXPECT_GT(added, 0.01 * sum);
    EXPECT_LT(difference, 0.01 * sum);
    EXPECT_LT(static_cast<double>(far), 0.02 * static_cast<double>(values.size()));
  }
}

TEST(RenderSurface, LayersMatchTheReference) {
  for (const bool floor : {false, true}) {
    const double exempt = expect_device_matches(
        net(128, floor), render_info(33, 17, even_directions(7), even_directions(13)));
    EXPECT_LT(exempt, 0.02);
  }
}

TEST(RenderSurface, MasksMatchTheReference) {
  Device device("auto");
  const Surface surface = net(128);
  BtfInfo info = render_info(24, 16, even_directions(7), even_directions(1));
  BtfInfo expected = info;
  render_surface_mask(device, surface, render_options(1), info);
  render_surface_mask_reference(surface, render_options(1), expected);
  ASSERT_EQ(info.mask.size(), 7u * 24 * 16);
  ASSERT_EQ(info.mask_distance.size(), info.mask.size());
  // A view ray in a thousand may turn out differently, and a texel has sixteen.
  std::size_t different = 0;
  for (std::size_t i = 0; i < info.mask.size(); ++i) {
    different += info.mask[i] != expected.mask[i] ||
                 std::abs(info.mask_distance[i] - expected.mask_distance[i]) > 1e-6;
  }
  EXPECT_LT(static_cast<double>(different), 0.05 * static_cast<double>(info.mask.size()));
  // No view meets a floor that has none.
  render_surface_mask(device, small_cloth(), render_options(1), info);
  EXPECT_TRUE(info.mask.empty());
  EXPECT_TRUE(info.mask_distance.empty());
}

// What a ray may rely on when it leaves points out.
TEST(RenderSurface, CeilingsBoundTheirBlocks) {
  for (const std::size_t columns : {1u, 4u, 8u, 16u, 64u}) {
    const std::size_t rows = 32;
    Surface surface = make_flat_surface(columns, rows, 1, 1, 2);
    Random random(3 + columns);
    for (SurfaceLayer& layer : surface.layers) {
      for (float& z : layer.elevation) z = static_cast<float>(random.uniform(-1, 1));
    }
    finish_surface(surface);
    const std::vector<float> ceilings = surface_ceilings(surface);
    const std::size_t side = std::size_t{1} << block_bits;
    const std::size_t across = (columns + side - 1) / side;
    ASSERT_EQ(ceilings.size(), across * ((rows + side - 1) / side));
    for (std::size_t block = 0; block < ceilings.size(); ++block) {
      float highest = -2;
      const auto margin = static_cast<std::ptrdiff_t>(side) + 1;
      const auto end = static_cast<std::ptrdiff_t>(side) + margin;
      for (std::ptrdiff_t dy = -margin; dy < end; ++dy) {
        for (std::ptrdiff_t dx = -margin; dx < end; ++dx) {
          const auto wrap = [](std::size_t first, std::ptrdiff_t by, std::size_t size) {
            const auto length = static_cast<std::ptrdiff_t>(size);
            return static_cast<std::size_t>(
                ((static_cast<std::ptrdiff_t>(first) + by) % length + length) % length);
          };
          const std::size_t i = wrap(block / across * side, dy, rows) * columns +
                                wrap(block % across * side, dx, columns);
          for (const SurfaceLayer& layer : surface.layers) {
            highest = std::max(highest, layer.elevation[i]);
          }
        }
      }
      EXPECT_EQ(ceilings[block], highest) << columns << " " << block;
    }
  }
}

// The launchers write all of their output and nothing round it.
void expect_confined(const Surface& surface, std::size_t width, std::size_t height,
                     std::size_t light_count, DType dtype, std::size_t samples,
                     std::size_t bounces) {
  Device device("auto");
  const BtfInfo info = render_info(width, height, {direction_from_degrees(50, 33)},
                                   even_directions(light_count), dtype);
  SurfaceRenderOptions options = render_options(samples);
  options.bounces = bounces;
  const DeviceSurface tables(device, surface);
  // Where there are several rows: the lower rows, or a part of the second row.
  TexelBand band{0, height, 0, width};
  if (height > 1)
    band = width % 2 ? TexelBand{1, height - 1, 0, width} : TexelBand{1, 1, 3, width - 3};
  GuardedBuffer hits(device, band.texels() * samples * surface_hit_bytes, "hits");
  GuardedBuffer second(device, band.texels() * samples * surface_bounce_bytes, "bounces");
  const std::vector<float> packed = pack_surface_lights(device, surface, info, 0, light_count);
  GuardedBuffer lights(device, std::span<const float>(packed), "lights");
  GuardedBuffer out(device, light_count * band.texels() * 3 * size_of(dtype), "out");
  GuardedBuffer mask(device, width * height, "mask");
  launch_surface_hits(device, surface, tables, info, options, 0, band, hits.buffer());
  if (bounces > 0) {
    launch_surface_bounce(device, surface, tables, info, options, 0, band, hits.buffer(),
                          second.buffer());
  }
  launch_surface_shade(device, surface, tables, info, options, 0, band, hits.buffer(),
                       second.buffer(), lights.buffer(), light_count, out.buffer());
  launch_surface_mask(device, surface, tables, info, options, 0, width, height, mask.buffer());
  device.finish();
  EXPECT_TRUE(hits.intact());
  EXPECT_TRUE(second.intact());
  EXPECT_TRUE(lights.intact());
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(mask.intact());
  for (const float value : hits.values<float>()) ASSERT_TRUE(std::isfinite(value));
  for (const std::uint8_t value : mask.values<std::uint8_t>()) ASSERT_LE(value, 1);
  // Compare with the whole image rendered the usual way.
  MemorySink sink(info);
  render_surface(device, surface, options, sink);
  const std::vector<std::byte> bytes = out.values<std::byte>();
  const std::size_t texel_bytes = 3 * size_of(dtype), run = band.columns * texel_bytes;
  for (std::size_t i = 0; i < light_count * band.rows; ++i) {
    const std::size_t texel = (band.first_row + i % band.rows) * width + band.first_column;
    const std::size_t place = i / band.rows * info.image_bytes() + texel * texel_bytes;
    const auto expected = sink.bytes().subspan(place, run);
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), &bytes[i * run])) << i;
  }
}

TEST(RenderSurface, WritesItsOutputOnly) {
  const Surface cloth = small_cloth(32), holes = net(32);
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    expect_confined(cloth, 1, 1, 1, dtype, 1, 0);
    expect_confined(cloth, 7, 5, 8, dtype, 3, 0);
    expect_confined(cloth, 33, 17, 17, dtype, 1, 0);
    expect_confined(cloth, 16, 4, 15, dtype, 2, 0);
  }
  expect_confined(cloth, 16, 4, 16, DType::f32, 2, 1);
  expect_confined(holes, 17, 3, 33, DType::f32, 2, 1);
}

TEST(RenderSurface, SmallForTheSimulator) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    expect_confined(small_cloth(32), 5, 3, 9, dtype, 2, 0);
  }
  expect_confined(net(16, true), 5, 3, 9, DType::f32, 1, 1);
}

}  // namespace
}  // namespace weft::test
