// A BTF in other directions: the device against the reference, and both against what the
// interpolation keeps exactly.
#include "weft/codecs/resampled_source.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/reference/resample.hpp"

namespace weft::test {
namespace {

using Vector = std::array<double, 3>;

Vector vector_of(const Direction& d) {
  const double length = std::hypot(double{d[0]}, double{d[1]}, double{d[2]});
  return {d[0] / length, d[1] / length, d[2] / length};
}

std::vector<float> read_floats(TileSource& source, std::size_t run) {
  const BtfInfo& info = source.info();
  std::vector<float> values(info.shape.values());
  const std::span<std::byte> bytes = std::as_writable_bytes(std::span(values));
  for (std::size_t i = 0; i < info.shape.images(); i += run) {
    const std::size_t count = std::min(run, info.shape.images() - i);
    source.read(i, count, bytes.subspan(i * info.image_bytes(), count * info.image_bytes()));
  }
  return values;
}

// Values f(view, light) of every pair, the same for every texel but times 1 + texel / 10.
std::shared_ptr<MemorySource> source_of_directions(
    const std::vector<Direction>& views, const std::vector<Direction>& lights,
    const std::function<double(const Vector&, const Vector&)>& f) {
  BtfInfo info = make_info({views.size(), lights.size(), 2, 2, 1});
  info.view_directions = views;
  info.light_directions = lights;
  std::vector<double> values;
  for (const Direction& view : views) {
    for (const Direction& light : lights) {
      for (int p = 0; p < 4; ++p) {
        values.push_back(f(vector_of(view), vector_of(light)) * (1 + p / 10.0));
      }
    }
  }
  return std::make_shared<MemorySource>(info, encode_values(values, DType::f32));
}

// The bound of a float product after the other, with both matrices rounded to float.
std::vector<double> error_bound(Resampling resampling, std::size_t n, std::vector<double> values) {
  for (auto* list : {&resampling.lights, &resampling.views, &resampling.zenith, &values}) {
    for (double& x : *list) x = std::abs(x);
  }
  resampling.largest = 0;
  Device& device = shared_device();
  const std::size_t terms = ops::gemm_terms(device, resampling.measured_lights) +
                            ops::gemm_terms(device, resampling.frames.size()) +
                            ops::gemm_terms(device, resampling.measured_views) + 3;
  std::vector<double> bound = reference::resample(resampling, n, values, 0, resampling.new_views);
  for (double& x : bound) x *= gamma(static_cast<double>(terms), float_roundoff);
  return bound;
}

void expect_device_is_reference(MemorySource& source, const Resampling& resampling) {
  Job job;
  ResampledSource on_device(&shared_device(), source, resampling, job);
  ResampledSource by_reference(nullptr, source, resampling, job);
  const std::vector<float> actual = read_floats(on_device, 3);
  const std::vector<float> expected = read_floats(by_reference, 5);
  const BtfShape& shape = source.info().shape;
  const std::vector<double> bound = error_bound(resampling, shape.image_values(),
                                                decode_values(source.bytes(), source.info().dtype));
  // the reference's results are rounded once, too
  EXPECT_TRUE(all_near(actual, expected,
                       [&](std::size_t i) { return bound[i] + std::abs(expected[i]) * 0x1p-24; }));
  EXPECT_GE(*std::min_element(actual.begin(), actual.end()), 0);
}

TEST(ResampledSource, DeviceIsReferenceWithinRounding) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    for (const std::size_t channels : {1u, 3u}) {
      const auto source = random_source({5, 7, 9, 11, channels}, dtype, 3, -0.2, 1.0);
      expect_device_is_reference(
          *source, resample_to(source->info(), even_directions(4), even_directions(9)));
      expect_device_is_reference(*source, resample_to(source->info(), OnionSizes{3, 2, 3, 4}));
    }
  }
}

TEST(ResampledSource, SmallOneOfEverything) {
  const auto source = random_source({1, 1, 1, 1, 1}, DType::f32, 3);
  expect_device_is_reference(*source,
                             resample_to(source->info(), even_directions(1), even_directions(2)));
  expect_device_is_reference(*source, resample_to(source->info(), OnionSizes{2, 2, 1, 2}));
}

TEST(ResampledSource, ZenithThatIsMadeIsReference) {
  auto source = random_source({6, 7, 5, 3, 3}, DType::f32, 8);
  BtfInfo info = source->info();
  for (std::size_t v = 0; v < 6; ++v) {
    info.view_directions[v] = direction_from_degrees(40, 60.0 * static_cast<double>(v));
  }
  MemorySource ring(info, {source->bytes().begin(), source->bytes().end()}, true);
  const Resampling resampling = resample_to(info, OnionSizes{4, 3, 5, 5});
  EXPECT_EQ(resampling.zenith.size(), 6u);
  EXPECT_EQ(resampling.frames.size(), 6u + 4u);
  expect_device_is_reference(ring, resampling);
}

TEST(ResampledSource, MeasuredDirectionsKeepTheirBits) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const auto source = random_source({6, 8, 5, 7, 3}, dtype, 9);
    const BtfInfo& info = source->info();
    Job job;
    ResampledSource same(&shared_device(), *source,
                         resample_to(info, info.view_directions, info.light_directions), job);
    EXPECT_TRUE(all_near(read_floats(same, 6), decode_values(source->bytes(), dtype),
                         dtype == DType::u8 ? 0x1p-24 : 0));  // x / 255 as float
  }
}

TEST(ResampledSource, NoBitDependsOnTheMemory) {
  const auto source = random_source({9, 8, 24, 16, 3}, DType::f16, 4);
  const Resampling resampling =
      resample_to(source->info(), even_directions(40), even_directions(30));
  Job large, small;
  ResampledSource whole(&shared_device(), *source, resampling, large);
  EXPECT_EQ(whole.passes(), 1u);
  small.memory = std::size_t{8} << 20;
  ResampledSource parts(&shared_device(), *source, resampling, small);
  EXPECT_GT(parts.passes(), 1u);
  EXPECT_TRUE(all_equal(read_floats(parts, 7), read_floats(whole, 1200)));
  small.memory = 100000;
  expect_error(ErrorKind::input, {"memory"},
               [&] { const ResampledSource none(&shared_device(), *source, resampling, small); });
}

// At the zenith no turn of the grid may show: what is linear in the light of the surface's frame is
// kept by every pair, with the zenith measured or made.
TEST(ResampledSource, TurnsOfTheZenithAgree) {
  const auto f = [](const Vector&, const Vector& l) { return 2 + l[0] - 0.5 * l[1]; };
  std::vector<Direction> ring;
  for (int i = 0; i < 8; ++i) ring.push_back(direction_from_degrees(45, 45 * i));
  std::vector<Direction> with_zenith = ring;
  with_zenith.insert(with_zenith.begin() + 3, Direction{0, 0, 1});
  for (const auto& views : {ring, with_zenith}) {
    auto source = source_of_directions(views, ubo81_directions(), f);
    const Resampling resampling = resample_to(source->info(), OnionSizes{8, 3, 9, 9});
    Job job;
    ResampledSource resampled(&shared_device(), *source, resampling, job);
    const BtfInfo& info = resampled.info();
    ASSERT_EQ(info.layout, Layout::paired);
    ASSERT_EQ(info.shape.views, 8u * 3 * 9 * 9);
    const std::vector<float> values = read_floats(resampled, 1000);
    std::size_t compared = 0;
    for (std::size_t i = 0; i < info.shape.views; ++i) {
      const double view_theta = theta_degrees(info.view_directions[i]);
      // of views that are measured or made, lights inside the hull
      if (view_theta > 46 || theta_degrees(info.light_directions[i]) > 74) continue;
      const double expected = f({}, vector_of(info.light_directions[i]));
      for (std::size_t p = 0; p < 4; ++p) {
        // rounding of 81 products of values up to 4, with weights that sum up to 2 or so
        EXPECT_NEAR(values[i * 4 + p], expected * (1 + static_cast<double>(p) / 10), 1e-5);
      }
      ++compared;
    }
    EXPECT_GT(compared, 300u);
  }
}

// A lobe round the mirrored view, between rings of views: turned with the view it stays one lobe.
TEST(ResampledSource, HighlightsOfTurnedLightsStayOne) {
  const auto lobe = [](const Vector& v, const Vector& l) {
    return 0.1 + std::exp(12 * (-v[0] * l[0] - v[1] * l[1] + v[2] * l[2] - 1));
  };
  auto source = source_of_directions(ubo81_directions(), ubo81_directions(), lobe);
  const OnionSizes sizes{16, 7, 11, 11};
  const Resampling onion = resample_to(source->info(), sizes);
  const OnionSlices grid(sizes);
  Job job;
  ResampledSource turned(&shared_device(), *source, onion, job);
  const std::vector<float> values = read_floats(turned, 1000);
  double error = 0, square = 0, plain_error = 0;
  for (std::size_t j = 1; j < 6; ++j) {
    for (std::size_t k = 0; k < 16; ++k) {
      const std::vector<Direction> view{grid.views()[k * 7 + j]};
      ResampledSource plain(nullptr, *source, resample_to(source->info(), view, grid.lights(k)),
                            job);
      const std::vector<float> other = read_floats(plain, 121);
      for (std::size_t l = 0; l < 121; ++l) {
        const std::size_t pair = (k * 7 + j) * 121 + l;
        if (theta_degrees(onion.info.light_directions[pair]) > 74) continue;
        const double expected =
            lobe(vector_of(view[0]), vector_of(onion.info.light_directions[pair]));
        error += std::pow(values[pair * 4] - expected, 2);
        plain_error += std::pow(other[l * 4] - expected, 2);
        square += expected * expected;
      }
    }
  }
  // the lobe is 15 degrees wide, as far as the rings are apart
  EXPECT_LT(std::sqrt(error / square), 0.1);
  EXPECT_LT(error, plain_error);
}

TEST(ResampledSource, RadianceFallsToZeroAtTheHorizon) {
  const auto cosine = [](const Vector&, const Vector& l) { return l[2]; };
  auto source = source_of_directions(ubo81_directions(), ubo81_directions(), cosine);
  const std::vector<Direction> lights{direction_from_degrees(80, 0), direction_from_degrees(90, 7),
                                      direction_from_degrees(33, 200)};
  Job job;
  ResampledSource radiance(&shared_device(), *source,
                           resample_to(source->info(), even_directions(2), lights), job);
  std::vector<float> values = read_floats(radiance, 6);
  EXPECT_NEAR(values[0], lights[0][2], 1e-6);
  EXPECT_NEAR(values[4], 0, 1e-6);
  EXPECT_NEAR(values[8], lights[2][2], 1e-6);
  // A BRDF has no cosine in it.
  BtfInfo info = source->info();
  info.quantity = Quantity::brdf;
  MemorySource brdf(info, {source->bytes().begin(), source->bytes().end()});
  ResampledSource clamped(&shared_device(), brdf, resample_to(info, even_directions(2), lights),
                          job);
  EXPECT_NEAR(read_floats(clamped, 6)[0], std::cos(75 * std::numbers::pi / 180), 1e-6);
}

TEST(ResampledSource, MasksAreOfTheNearestView) {
  auto source = random_source({2, 3, 2, 1, 1}, DType::f32, 1);
  BtfInfo info = source->info();
  info.view_directions = {direction_from_degrees(0, 0), direction_from_degrees(60, 0)};
  info.mask = {1, 1, 0, 1};
  info.mask_distance = {0.5f, 0.25f, -0.5f, 0.75f};
  MemorySource masked(info, {source->bytes().begin(), source->bytes().end()});
  Job job;
  const std::vector<Direction> views{direction_from_degrees(20, 180), direction_from_degrees(50, 9),
                                     direction_from_degrees(80, 0)};
  ResampledSource grid(nullptr, masked, resample_to(info, views, even_directions(2)), job);
  EXPECT_TRUE(grid.info().mask.empty());
  grid.take_masks();
  EXPECT_EQ(grid.info().mask, (std::vector<std::uint8_t>{1, 1, 0, 1, 0, 1}));
  EXPECT_EQ(grid.info().mask_distance,
            (std::vector<float>{0.5f, 0.25f, -0.5f, 0.75f, -0.5f, 0.75f}));
  validate(grid.info(), "grid");
  ResampledSource pairs(nullptr, masked, resample_to(info, OnionSizes{2, 2, 2, 2}), job);
  pairs.take_masks();
  EXPECT_EQ(pairs.info().mask.size(), 16u * 2);
  validate(pairs.info(), "pairs");
}

TEST(ResampledSource, TexelsInTheirOwnOrder) {
  const auto source = random_source({3, 4, 2, 3, 3}, DType::f32, 2);
  const Resampling resampling = resample_to(source->info(), OnionSizes{2, 2, 3, 3});
  Job job;
  ResampledSource images(&shared_device(), *source, resampling, job);
  const std::vector<float> expected = read_floats(images, 36);
  TexelResampler texels(shared_device(), *source, resampling, job);
  std::size_t seen = 0;
  texels.for_each(0, 4, [&](const Buffer& values, std::size_t first, std::size_t count) {
    Buffer ordered(shared_device(), 36 * count * 3 * sizeof(float), "texels");
    order_by_texel(shared_device(), resampling, 3, count, values, ordered);
    std::vector<float> host(36 * count * 3);
    shared_device().read(ordered, std::span<float>(host));
    for (std::size_t i = 0; i < host.size(); ++i) {
      const std::size_t c = i % 3, image = i / 3 % 36, p = first + i / 3 / 36;
      EXPECT_EQ(host[i], expected[(image * 6 + p) * 3 + c]);
    }
    seen += count;
  });
  EXPECT_EQ(seen, 6u);
}

TEST(ResampledSource, WhatCannotBeInterpolatedIsRefused) {
  const auto source = random_source({3, 4, 2, 3, 1}, DType::f32, 2);
  BtfInfo paired = source->info();
  paired.layout = Layout::paired;
  expect_error(ErrorKind::input, {"paired"},
               [&] { resample_to(paired, even_directions(2), even_directions(2)); });
  const std::vector<Direction> below{{0, 0.6f, -0.8f}};
  expect_error(ErrorKind::input, {"new view direction 0", "below the horizon"},
               [&] { resample_to(source->info(), below, even_directions(2)); });
  expect_error(ErrorKind::input, {"new light direction 0", "below the horizon"},
               [&] { resample_to(source->info(), even_directions(2), below); });
  // NaN
  std::vector<double> values = decode_values(source->bytes(), DType::f32);
  values[4 * 6 + 6 + 2] = std::nan("");
  const auto broken = source_of(source->info().shape, DType::f32, values);
  const Resampling resampling = resample_to(broken->info(), even_directions(2), even_directions(2));
  for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
    Job job;
    expect_error(ErrorKind::input, {"view 1, light 1, row 0, column 2"},
                 [&] { const ResampledSource resampled(device, *broken, resampling, job); });
    job.nan_zero = true;
    ResampledSource zeroed(device, *broken, resampling, job);
    for (const float value : read_floats(zeroed, 4)) EXPECT_TRUE(std::isfinite(value));
  }
}

}  // namespace
}  // namespace weft::test
