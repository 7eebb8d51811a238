// Shading on the device against the reference, and both against what is known.
#include "weft/render/shade.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/btf/view_grid.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/scene/render_picture.hpp"
#include "weft/scene/texture_taps.hpp"

namespace weft::test {
namespace {

constexpr double pi = std::numbers::pi;

std::array<float, 3> from_degrees(double theta, double phi) {
  return direction_from_degrees(theta, phi);
}

struct Batch {
  std::vector<ShadingPoint> points;
  std::vector<LightSample> lights;
};

// Points anywhere on the material, from texels seen large to the whole in one pixel.
Batch random_batch(std::size_t points, std::size_t samples) {
  Random random(17);
  Batch batch;
  for (std::size_t i = 0; i < points; ++i) {
    ShadingPoint point;
    point.pixel = static_cast<std::uint32_t>(i);
    point.uv = {static_cast<float>(random.uniform()), static_cast<float>(random.uniform())};
    const double footprint = std::exp2(random.uniform(-8, 1));
    point.footprint = {static_cast<float>(footprint),
                       static_cast<float>(footprint * random.uniform())};
    point.view = from_degrees(random.uniform(0, 90), random.uniform(0, 360));
    batch.points.push_back(point);
    for (std::size_t s = 0; s < samples; ++s) {
      LightSample light;
      light.direction = from_degrees(random.uniform(0, 90), random.uniform(0, 360));
      const bool dark = random.index(4) == 0;
      for (float& e : light.irradiance) e = dark ? 0.0f : static_cast<float>(random.uniform());
      batch.lights.push_back(light);
    }
  }
  return batch;
}

// The same points, seen so large that they look into the finest level alone, which is stored as it
// is: nothing is rounded to bytes or halves again.
Batch seen_large(Batch batch) {
  for (ShadingPoint& point : batch.points) point.footprint = {0, 0};
  return batch;
}

std::vector<PointRadiance> shade(Shader& shader, const Batch& batch, Job& job) {
  std::vector<PointRadiance> radiance(batch.points.size());
  shader.shade(batch.points, batch.lights, radiance, job);
  return radiance;
}

std::vector<double> flat(const std::vector<PointRadiance>& radiance) {
  std::vector<double> values;
  for (const PointRadiance& point : radiance)
    values.insert(values.end(), point.begin(), point.end());
  return values;
}

std::shared_ptr<MemorySource> material(const BtfShape& shape, DType dtype, Encoding encoding,
                                       Quantity quantity, bool masked, double least = 0.0) {
  BtfInfo info = make_info(shape, dtype);
  info.encoding = encoding;
  info.quantity = quantity;
  std::vector<double> values = random_values(shape.values(), 3, least, 1.0);
  if (masked) {
    Random random(4);
    for (std::size_t i = 0; i < shape.views * shape.texels(); ++i) {
      info.mask.push_back(random.index(4) == 0 ? 0 : 1);
    }
    for (std::size_t i = 0; i < values.size(); ++i) {  // nothing is reflected by holes
      const std::size_t texel = i / shape.channels % shape.texels();
      const std::size_t view = i / shape.image_values() / shape.lights;
      if (info.mask[view * shape.texels() + texel] == 0) values[i] = 0;
    }
  }
  return std::make_shared<MemorySource>(info, encode_values(values, dtype));
}

// Bound of |device - reference| of what one light sample of irradiance up to 1 adds: weights of
// directions within 2e-5 (weigh_directions_test.cpp: 3 rows of at most 8, and 4e-6), six of them,
// and sums of 40 terms; the steepest encoding has slope 2.4, and division by a mask and
// multiplication double it; the light's scale is at most 4 and as exact. 8-bit levels may round to
// the next byte.
double sample_tolerance(DType dtype) {
  const double step = dtype == DType::u8 ? 8.0 / 255 : dtype == DType::f16 ? 8 * 0x1p-11 : 0;
  return 4 * 2 * 2.4 * (6 * 2e-5 + gamma(40, float_roundoff) + step);
}

struct Material {
  DType dtype;
  Encoding encoding;
  Quantity quantity;
  std::size_t channels;
  bool masked;
};

constexpr Material materials[] = {
    {DType::f32, Encoding::linear, Quantity::radiance, 3, false},
    {DType::u8, Encoding::srgb, Quantity::radiance, 3, true},
    {DType::f16, Encoding::gamma22, Quantity::brdf, 3, true},
    {DType::f32, Encoding::linear, Quantity::brdf, 1, true},
};

// A model with mip levels of its own.
TEST(Shade, SmallModel) {
  const Batch batch = random_batch(3, 2);
  const auto source =
      material({7, 8, 4, 4, 3}, DType::f32, Encoding::linear, Quantity::radiance, false);
  Job job;
  const Codec& codec = find_codec("pca");
  const std::shared_ptr<const Model> model =
      codec.encode_reference(*source, {{"rank", "3"}}, Storage::f16, job);
  const auto device = make_shader(&shared_device(), model, job);
  const auto reference = make_shader(nullptr, model, job);
  EXPECT_TRUE(
      all_near(flat(shade(*device, batch, job)), flat(shade(*reference, batch, job)),
               2 * 2 * sample_tolerance(DType::f32) + 2 * codec.decode_tolerance(*model) * 40));
}

// Points seen large look up the entry of a model's grid of views that they are in, whatever their
// direction within it; and levels that are taken of images look between the measured views.
TEST(Shade, ModelsWithAGridOfViews) {
  const auto source =
      material({9, 8, 4, 4, 3}, DType::f32, Encoding::linear, Quantity::radiance, false);
  Job job;
  const Codec& codec = find_codec("kcta");
  const std::shared_ptr<const Model> model = codec.encode_reference(
      *source, {{"clusters", "3"}, {"mixtures", "2"}, {"ranks", "v=2"}, {"resample-views", "8"}},
      Storage::f32, job);
  const auto device = make_shader(&shared_device(), model, job);
  const auto reference = make_shader(nullptr, model, job);
  const double tolerance =
      2 * 2 * sample_tolerance(DType::f32) + 2 * codec.decode_tolerance(*model) * 40;
  const Batch batch = random_batch(60, 2);
  EXPECT_TRUE(
      all_near(flat(shade(*device, batch, job)), flat(shade(*reference, batch, job)), tolerance));

  Batch large = seen_large(random_batch(20, 1));
  const std::vector<PointRadiance> found = shade(*device, large, job);
  const ViewGrid grid(8);
  for (std::size_t i = 0; i < large.points.size(); ++i) {
    const auto& view = large.points[i].view;
    const auto d = grid.direction(grid.entry({view[0], view[1], view[2]}));
    for (std::size_t k = 0; k < 3; ++k) {
      // a little towards the centre of its entry
      large.points[i].view[k] = static_cast<float>(0.7 * double{view[k]} + 0.3 * d[k]);
    }
  }
  EXPECT_EQ(flat(shade(*device, large, job)), flat(found));
}

// Points seen large look up a model of all directions at the view and the light themselves, with
// nothing between measured ones.
TEST(Shade, SmallModelsOfAllDirections) {
  const OnionSizes sizes{4, 3, 3, 4};
  const bool simulated = is_simulator(shared_device());
  constexpr std::size_t side = 4;
  auto random = std::make_shared<VqModel>(
      random_vq({7, 8, side, side, 3}, {VqGrid::Kind::onion, sizes}, small_sizes, 6));
  for (const Quantity quantity : {Quantity::radiance, Quantity::brdf}) {
    random->info.btf.quantity = quantity;
    const std::shared_ptr<const Model> model = random;
    Job job;
    const auto device = make_shader(&shared_device(), model, job);
    const auto reference = make_shader(nullptr, model, job);
    Batch batch = seen_large(random_batch(simulated ? 3 : 100, 1));
    batch.lights.back().direction[2] *= -1;  // from below the horizon
    std::vector<double> expected, tolerances, values(3);
    for (std::size_t i = 0; i < batch.points.size(); ++i) {
      const ShadingPoint& point = batch.points[i];
      const LightSample& light = batch.lights[i];
      const TexelTaps taps = texel_taps(point.uv, side, side);
      std::array<double, 4> sum{0, 0, 0, 1};
      const double cosine = std::max(double{light.direction[2]}, 0.0);
      const double factor = quantity == Quantity::brdf ? cosine : cosine > 0 ? 1 : 0;
      for (std::size_t t = 0; t < 4; ++t) {
        model->fitted_texel_at(point.view, light.direction, taps.texel[t] / side,
                               taps.texel[t] % side, values);
        for (std::size_t c = 0; c < 3; ++c) {
          sum[c] += double{taps.weight[t]} * values[c] * factor * double{light.irradiance[c]};
        }
      }
      expected.insert(expected.end(), sum.begin(), sum.end());
      tolerances.push_back(place_error(sizes, point.view, light.direction) +
                           2 * find_codec("vq").decode_tolerance(*model) +
                           gamma(20, float_roundoff));
    }
    EXPECT_TRUE(all_near(flat(shade(*reference, batch, job)), expected, 2 * float_roundoff));
    EXPECT_TRUE(all_near(flat(shade(*device, batch, job)), expected,
                         [&](std::size_t i) { return tolerances[i / 4]; }));
  }
}

// Their coarser levels, which are taken of images, look between measured directions.
TEST(Shade, LevelsOfModelsOfAllDirections) {
  const OnionSizes sizes{8, 4, 5, 6};
  const std::shared_ptr<const Model> model = std::make_shared<VqModel>(
      random_vq({9, 11, 6, 7, 3}, {VqGrid::Kind::onion, sizes}, small_sizes, 2));
  Job job;
  const auto device = make_shader(&shared_device(), model, job);
  const auto reference = make_shader(nullptr, model, job);
  const Batch batch = random_batch(100, 2);
  std::vector<double> tolerances;
  for (std::size_t i = 0; i < batch.points.size(); ++i) {
    double tolerance = 2 * 2 * sample_tolerance(DType::f32);
    for (std::size_t s = 0; s < 2; ++s) {
      tolerance += place_error(sizes, batch.points[i].view, batch.lights[2 * i + s].direction);
    }
    tolerances.push_back(tolerance);
  }
  EXPECT_TRUE(all_near(flat(shade(*device, batch, job)), flat(shade(*reference, batch, job)),
                       [&](std::size_t i) { return tolerances[i / 4]; }));
}

TEST(Shade, DeviceAndReferenceAgreeOfRaw) {
  const Batch batch = random_batch(150, 3);
  for (const Material& m : materials) {
    const auto source =
        material({9, 11, 6, 7, m.channels}, m.dtype, m.encoding, m.quantity, m.masked);
    Job job;
    const auto device = make_shader(&shared_device(), source, job);
    const auto reference = make_shader(nullptr, source, job);
    EXPECT_TRUE(all_near(flat(shade(*device, batch, job)), flat(shade(*reference, batch, job)),
                         3 * sample_tolerance(m.dtype)));
    const Batch large = seen_large(batch);
    EXPECT_TRUE(all_near(flat(shade(*device, large, job)), flat(shade(*reference, large, job)),
                         3 * sample_tolerance(DType::f32)));
  }
}

TEST(Shade, DeviceAndReferenceAgreeOfModels) {
  const Batch batch = random_batch(100, 2);
  for (const Codec* codec : codecs()) {
    if (codec->name() != "pca" && codec->name() != "view-pca" && codec->name() != "lpca") continue;
    for (const Material& m : {materials[0], materials[1]}) {
      const auto source = material({9, 11, 6, 7, 3}, m.dtype, m.encoding, m.quantity, m.masked);
      Job job;
      const std::shared_ptr<const Model> model =
          codec->encode(shared_device(), *source, {{"rank", "5"}}, Storage::f16, job);
      const auto device = make_shader(&shared_device(), model, job);
      const auto reference = make_shader(nullptr, model, job);
      // decoded values may overshoot [0, 1], by less than their range; levels of decoded images are
      // floats
      EXPECT_TRUE(all_near(flat(shade(*device, batch, job)), flat(shade(*reference, batch, job)),
                           2 * 2 * sample_tolerance(DType::f32) +
                               2 * codec->decode_tolerance(*model) * 40 +
                               (m.masked ? 2 * sample_tolerance(DType::u8) : 0)))
          << codec->name();
      const Batch large = seen_large(batch);
      EXPECT_TRUE(
          all_near(flat(shade(*device, large, job)), flat(shade(*reference, large, job)),
                   2 * 2 * sample_tolerance(DType::f32) + 2 * codec->decode_tolerance(*model) * 40))
          << codec->name();
    }
  }
}

// Points get the same bits in any batch, and whether images are resident or streamed.
TEST(Shade, SameBitsWhateverTheMemory) {
  const Batch batch = random_batch(120, 2);
  const auto source =
      material({9, 11, 16, 16, 3}, DType::f16, Encoding::linear, Quantity::radiance, true);
  Job job;
  const auto whole = make_shader(&shared_device(), source, job);
  const std::vector<double> expected = flat(shade(*whole, batch, job));
  Job small;
  small.memory = 1500000;  // not enough for the finest level beside a run of images and a batch
  const auto streamed = make_shader(&shared_device(), source, small);
  // there is room left for those who make the points
  EXPECT_LE(streamed->bytes(), small.memory - small.memory / 32);
  const std::size_t read_before = source->images_read();
  EXPECT_TRUE(all_equal(flat(shade(*streamed, batch, small)), expected));
  EXPECT_GT(source->images_read(), read_before);

  Batch part{{batch.points.begin() + 50, batch.points.begin() + 61},
             {batch.lights.begin() + 100, batch.lights.begin() + 122}};
  EXPECT_TRUE(
      all_equal(flat(shade(*whole, part, job)), std::span(expected).subspan(4 * 50, 4 * 11)));

  small.memory = 1000;
  expect_error(ErrorKind::input, {"--memory 1000"},
               [&] { make_shader(&shared_device(), source, small); });
}

// A diffuse material of albedo a under one light, whichever way it is stored: a / pi cos(theta).
TEST(Shade, DiffuseMaterialIsExactAtMeasuredLights) {
  const std::vector<Direction> directions = ubo81_directions();
  const double albedo = 0.6;
  for (const Quantity quantity : {Quantity::brdf, Quantity::radiance}) {
    BtfInfo info = make_info({81, 81, 2, 2, 1}, DType::f32);
    info.view_directions = info.light_directions = directions;
    info.quantity = quantity;
    std::vector<double> values;
    for (std::size_t v = 0; v < 81; ++v) {
      for (const Direction& light : directions) {
        values.insert(values.end(), 4,
                      albedo / pi * (quantity == Quantity::brdf ? 1 : double{light[2]}));
      }
    }
    const auto source = std::make_shared<MemorySource>(info, encode_values(values, DType::f32));
    for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
      Job job;
      const auto shader = make_shader(device, source, job);
      Batch batch = random_batch(81, 1);
      for (std::size_t i = 0; i < 81; ++i) {
        batch.lights[i].direction = directions[i];
        batch.lights[i].irradiance = {1, 2, 3};
      }
      const auto radiance = shade(*shader, batch, job);
      for (std::size_t i = 0; i < 81; ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
          const double expected = static_cast<double>(c + 1) * albedo / pi * directions[i][2];
          EXPECT_NEAR(radiance[i][c], expected, 1e-5);
        }
        EXPECT_EQ(radiance[i][3], 1.0f);
      }
      // Beyond the last ring the light falls off with its cosine, down to nothing at the horizon.
      Batch low = random_batch(90, 1);
      for (std::size_t i = 0; i < 90; ++i) {
        low.lights[i].direction = from_degrees(static_cast<double>(i) / 89 * 90, 33.3);
        low.lights[i].irradiance = {1, 1, 1};
      }
      const auto falling = shade(*shader, low, job);
      for (std::size_t i = 0; i < 90; ++i) {
        const double cosine = std::max(0.0, double{low.lights[i].direction[2]});
        // Inside, the cosine is interpolated over triangles of up to 30 degrees: by less than
        // 1 / cos(15 degrees).
        EXPECT_NEAR(falling[i][0], albedo / pi * cosine, 0.04 * albedo / pi * cosine + 1e-6) << i;
      }
    }
  }
}

// Holes show what is behind, edges of masks mix it in; no edge is darker than both.
TEST(Shade, HolesHaveNoFringes) {
  BtfInfo info = make_info({1, 1, 1, 8, 3}, DType::u8);
  info.encoding = Encoding::srgb;
  info.quantity = Quantity::brdf;
  info.view_directions = info.light_directions = {{0, 0, 1}};
  std::vector<double> values;
  for (std::size_t x = 0; x < 8; ++x) {
    info.mask.push_back(x < 4 ? 1 : 0);
    values.insert(values.end(), 3, x < 4 ? 200.0 / 255 : 0.0);
  }
  const auto source = std::make_shared<MemorySource>(info, encode_values(values, DType::u8));
  const double full = std::pow((200.0 / 255 + 0.055) / 1.055, 2.4);
  for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
    Job job;
    const auto shader = make_shader(device, source, job);
    Batch batch;
    for (int i = 0; i < 64; ++i) {
      ShadingPoint point;
      point.pixel = static_cast<std::uint32_t>(i);
      point.uv = {static_cast<float>(i) / 64, 0.5f};
      const auto behind = static_cast<float>(full);
      point.behind = {behind, behind, behind};
      batch.points.push_back(point);
      batch.lights.push_back({{0, 0, 1}, {1, 1, 1}});
    }
    const auto radiance = shade(*shader, batch, job);
    std::vector<std::array<float, 4>> picture(64, std::array<float, 4>{});
    add_points(batch.points, radiance, 0, picture);
    for (std::size_t i = 0; i < 64; ++i) {
      EXPECT_NEAR(picture[i][0], full, 1e-5) << i;
      // premultiplied, and bilinear about the edges at 4 and 8 texels
      const double x = static_cast<double>(i) / 8 - 0.5;
      const double mask = x < 0 ? 1 + x : x < 3 ? 1 : x < 4 ? 4 - x : x < 7 ? 0 : x - 7;
      EXPECT_NEAR(radiance[i][3], mask, 1e-6) << i;
    }
  }
}

TEST(Shade, NegativeValuesAreClipped) {
  BtfInfo info = make_info({1, 1, 1, 1, 3}, DType::f32);
  const auto source =
      std::make_shared<MemorySource>(info, encode_values(std::vector{-0.5, 0.25, 0.0}, DType::f32));
  Batch batch{{ShadingPoint{}}, {LightSample{{0, 0, 1}, {1, 1, 1}}}};
  for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
    Job job;
    const auto radiance = shade(*make_shader(device, source, job), batch, job);
    EXPECT_EQ(radiance[0], (PointRadiance{0, 0.25f, 0, 1}));
  }
}

TEST(Shade, RefusesWhatItCannotShade) {
  BtfInfo info = make_info({4, 1, 2, 2, 3}, DType::f32);
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  const auto paired =
      std::make_shared<MemorySource>(info, encode_values(std::vector<double>(48, 0), DType::f32));
  const auto two = std::make_shared<MemorySource>(
      make_info({1, 1, 2, 2, 2}, DType::f32), encode_values(std::vector<double>(8, 0), DType::f32));
  Job job;
  for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
    expect_error(ErrorKind::input, {"'paired'"}, [&] { make_shader(device, paired, job); });
    expect_error(ErrorKind::input, {"2 channels"}, [&] { make_shader(device, two, job); });
  }
}

// A ball of a diffuse material: a / pi cos(theta), the background elsewhere, whatever the batches.
TEST(Shade, PictureOfADiffuseBall) {
  BtfInfo info = make_info({7, 7, 4, 4, 3}, DType::f32);
  info.quantity = Quantity::brdf;
  const auto source = std::make_shared<MemorySource>(
      info, encode_values(std::vector<double>(info.shape.values(), 0.5 / pi), DType::f32));
  Scene scene;
  scene.camera.width = 24;
  scene.camera.height = 20;
  scene.shape = make_sphere({2, 1});
  scene.lights = {light_at_degrees(40, 250, {pi, pi, pi})};
  scene.background = {0.125, 0.25, 0.5};
  const RayCaster caster(scene);
  PixelBatch rays;
  caster.cast(0, caster.pixels(), rays);
  Job job;
  const auto shader = make_shader(&shared_device(), source, job);
  const Picture picture = render_picture(caster, *shader, job);
  ASSERT_EQ(picture.pixels.size(), 480U);
  std::vector<double> expected(480, -1.0);
  for (std::size_t i = 0; i < rays.points.size(); ++i) {
    const LightSample& light = rays.lights[i];
    expected[rays.points[i].pixel] =
        0.5 / pi * std::max(0.0, double{light.direction[2]}) * double{light.irradiance[0]};
  }
  for (std::size_t i = 0; i < 480; ++i) {
    const auto& pixel = picture.pixels[i];
    EXPECT_EQ(pixel[3], expected[i] < 0 ? 0.0f : 1.0f);
    EXPECT_NEAR(pixel[0], expected[i] < 0 ? 0.125 : expected[i], 1e-5);
  }
  Job small;
  small.memory = shader->bytes() + 480 * 16 + 40 * (caster.bytes_per_pixel() + 16);
  const Picture again = render_picture(caster, *shader, small);
  EXPECT_EQ(again.pixels, picture.pixels);
  const auto reference = make_shader(nullptr, source, job);
  const Picture truth = render_picture(caster, *reference, job);
  for (std::size_t i = 0; i < 480; ++i) {
    EXPECT_TRUE(all_near(picture.pixels[i], truth.pixels[i], sample_tolerance(DType::f32) * pi));
  }
}

TEST(TextureTaps, AreBilinearAndPeriodic) {
  for (const auto& [height, width] : {std::array<std::size_t, 2>{4, 8}, {3, 5}, {1, 1}}) {
    Random random(3);
    for (int i = 0; i < 200; ++i) {
      const std::array<float, 2> uv{static_cast<float>(random.uniform()),
                                    static_cast<float>(random.uniform())};
      const TexelTaps taps = texel_taps(uv, height, width);
      double sum = 0;
      for (std::size_t t = 0; t < 4; ++t) {
        EXPECT_LT(taps.texel[t], height * width);
        EXPECT_GE(taps.weight[t], 0);
        sum += double{taps.weight[t]};
      }
      EXPECT_NEAR(sum, 1, 1e-6);
    }
  }
  // a texel's centre, the top edge's row first
  const TexelTaps centre = texel_taps({2.5f / 8, 1 - 1.5f / 4}, 4, 8);
  EXPECT_EQ(centre.texel[0], 1U * 8 + 2);
  EXPECT_EQ(centre.weight[0], 1.0f);
  // across the edges of a tile
  const TexelTaps corner = texel_taps({0, 0}, 4, 8);
  EXPECT_EQ(corner.texel, (std::array<std::uint32_t, 4>{3 * 8 + 7, 3 * 8, 7, 0}));
  for (const float weight : corner.weight) EXPECT_EQ(weight, 0.25f);
}

TEST(TextureTaps, LevelsFollowTheFootprint) {
  EXPECT_EQ(mip_taps({0, 0}, 64, 64).level, 0U);
  EXPECT_EQ(mip_taps({1.0f / 64, 1.0f / 64}, 64, 64).coarser, 0.0f);
  EXPECT_EQ(mip_taps({4.0f / 64, 4.0f / 64}, 64, 64).level, 2U);
  EXPECT_EQ(mip_taps({8.0f / 64, 1e-4f}, 64, 64).level, 2U);  // half the longer axis
  const MipTaps between = mip_taps({3.0f / 64, 3.0f / 64}, 64, 64);
  EXPECT_EQ(between.level, 1U);
  EXPECT_NEAR(between.coarser, std::log2(1.5), 1e-6);
  for (const float huge : {1.0f, 100.0f, 1e30f, std::numeric_limits<float>::infinity()}) {
    EXPECT_EQ(mip_taps({huge, huge}, 64, 64).level, 6U);
    EXPECT_EQ(mip_taps({huge, huge}, 64, 64).coarser, 0.0f);
  }
  EXPECT_EQ(mip_taps({std::nanf(""), 1}, 64, 64).level, 0U);
}

}  // namespace
}  // namespace weft::test
