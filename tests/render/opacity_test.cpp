// Opacities of materials with holes: of signed distances they are sharp however large they are
// seen, and coarser levels average them; on the device as by the reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/btf/mask_distance.hpp"
#include "weft/codecs/occlusion.hpp"
#include "weft/ops/shade.hpp"
#include "weft/render/shade.hpp"

namespace weft::test {
namespace {

const std::vector<Device*>& both() {
  static const std::vector<Device*> devices{&shared_device(), nullptr};
  return devices;
}

// A row of 8 texels, the first 4 of them of a white matt material.
std::shared_ptr<MemorySource> half_row() {
  BtfInfo info = make_info({1, 1, 1, 8, 3}, DType::f32);
  info.quantity = Quantity::brdf;
  info.view_directions = info.light_directions = {{0, 0, 1}};
  std::vector<double> values;
  for (std::size_t x = 0; x < 8; ++x) {
    info.mask.push_back(x < 4 ? 1 : 0);
    values.insert(values.end(), 3, x < 4 ? 0.5 : 0.0);
  }
  info.mask_distance = signed_distances(info.mask, 1, 8);
  normalize_distances(info.mask_distance);  // by 1.5 texels
  return std::make_shared<MemorySource>(info, encode_values(values, DType::f32));
}

struct Row {
  std::vector<ShadingPoint> points;
  std::vector<LightSample> lights;
};

Row row_of_points(std::size_t count, float footprint) {
  Row row;
  for (std::size_t i = 0; i < count; ++i) {
    ShadingPoint point;
    point.pixel = static_cast<std::uint32_t>(i);
    point.uv = {(static_cast<float>(i) + 0.5f) / static_cast<float>(count), 0.5f};
    point.footprint = {footprint, footprint};
    row.points.push_back(point);
    row.lights.push_back({{0, 0, 1}, {1, 1, 1}});
  }
  return row;
}

std::vector<PointRadiance> shade(Shader& shader, const Row& row, Job& job) {
  std::vector<PointRadiance> radiance(row.points.size());
  shader.shade(row.points, row.lights, radiance, job);
  return radiance;
}

// Of half a texel's ramp inside the outline.
constexpr VisibilityMapping ramp{1.0 / 3, 3};

// The kernel alone, of entries in any order; what lies between the listed ones is left alone.
TEST(Opacity, SmallPairsAreMapped) {
  Device& device = shared_device();
  const VisibilityMapping mapping{0.25, 3};
  for (const std::size_t count : Sizes{1, 3, 63, 64, 65, 130}) {
    std::vector<std::uint32_t> list;
    std::vector<float> values = random_floats(2 * count, 5, -0.5, 1.5);
    for (std::size_t i = 0; i < count; ++i) {
      list.push_back(static_cast<std::uint32_t>(2 * (count - 1 - i)));
    }
    values[1] = 0.25f;
    GuardedBuffer masks(device, std::span<const float>(std::vector<float>(4 * count, 7.0f)),
                        "masks");
    ops::ShadeTables tables;
    tables.masks = std::move(masks.buffer());
    Buffer listed(device, list.size() * sizeof(std::uint32_t), "entries");
    Buffer looked_up(device, values.size() * sizeof(float), "values");
    device.write(listed, std::span<const std::uint32_t>(list));
    device.write(looked_up, std::span<const float>(values));
    for (const bool mapped : {true, false}) {
      ops::set_opacities(device, count, listed, looked_up, mapped ? &mapping : nullptr, tables);
      std::vector<float> found(4 * count);
      device.read(tables.masks, std::span<float>(found));
      for (std::size_t i = 0; i < count; ++i) {
        const float* const pair = &found[2 * list[i]];
        EXPECT_EQ(pair[0], std::clamp(values[2 * i], 0.0f, 1.0f));
        const float number = values[2 * i + 1];
        const double expected =
            mapped ? mapping.alpha(double{number}) : std::clamp(double{number}, 0.0, 1.0);
        EXPECT_NEAR(pair[1], expected, 0x1p-22) << number;  // one product
        EXPECT_EQ(pair[2], 7.0f);
        EXPECT_EQ(pair[3], 7.0f);
      }
    }
    masks.buffer() = std::move(tables.masks);
    EXPECT_TRUE(masks.intact());
  }
}

TEST(Opacity, RowOfDistances) {
  const Row row = row_of_points(37, 0);
  for (Device* device : both()) {
    Job job;
    const auto shader = make_shader(device, half_row(), job, ramp);
    const auto radiance = shade(*shader, row, job);
    for (std::size_t i = 0; i < row.points.size(); ++i) {
      // distance to the outlines at 0 and 4 texels, but between centres of 1.5 texels it is flat
      const double x = static_cast<double>(row.points[i].uv[0]) * 8;
      const double inside = x < 4 ? std::min(x, 4 - x) : -std::min(x - 4, 8 - x);
      const double distance = std::clamp(inside, -1.5, 1.5) / 1.5;
      const double opacity = ramp.alpha(distance);
      EXPECT_NEAR(radiance[i][3], opacity, 1e-5) << x;
      // as white as where it is opaque
      EXPECT_NEAR(radiance[i][0], 0.5 * opacity, 1e-5) << x;
    }
  }
}

TEST(Opacity, CoarserLevelsAverageIt) {
  const Row row = row_of_points(5, 1);  // one pixel for all of it
  for (Device* device : both()) {
    Job job;
    const auto radiance = shade(*make_shader(device, half_row(), job, ramp), row, job);
    for (const PointRadiance& point : radiance) {
      EXPECT_NEAR(point[3], 0.5, 1e-5);
      EXPECT_NEAR(point[0], 0.25, 1e-5);
    }
  }
}

TEST(Opacity, WithoutAMappingItIsTheMask) {
  const Row row = row_of_points(16, 0);
  for (Device* device : both()) {
    Job job;
    const auto radiance = shade(*make_shader(device, half_row(), job), row, job);
    EXPECT_NEAR(radiance[0][3], 0.75, 1e-6);  // a quarter of a texel from the border
    EXPECT_NEAR(radiance[4][3], 1, 1e-6);
  }
}

// Threads of random size, whose values are 0 in the holes.
std::shared_ptr<MemorySource> random_material(const BtfShape& shape) {
  Random random(3);
  BtfInfo info = make_info(shape, DType::f32);
  info.quantity = Quantity::brdf;
  std::vector<double> values = random_values(shape.values(), 4);
  for (std::size_t i = 0; i < shape.views * shape.texels(); ++i) {
    info.mask.push_back(random.index(3) == 0 ? 0 : 1);
    const double size = random.uniform(0.05, 1);
    info.mask_distance.push_back(static_cast<float>(info.mask.back() != 0 ? size : -size));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t view = i / shape.image_values() / shape.lights;
    if (info.mask[view * shape.texels() + i / shape.channels % shape.texels()] == 0) values[i] = 0;
  }
  return std::make_shared<MemorySource>(info, encode_values(values, DType::f32));
}

Row random_points(std::size_t count) {
  Random random(7);
  Row row;
  for (std::size_t i = 0; i < count; ++i) {
    ShadingPoint point;
    point.pixel = static_cast<std::uint32_t>(i);
    point.uv = {static_cast<float>(random.uniform()), static_cast<float>(random.uniform())};
    const auto footprint = static_cast<float>(std::exp2(random.uniform(-8, 1)));
    point.footprint = {footprint, footprint};
    point.view = direction_from_degrees(random.uniform(0, 90), random.uniform(0, 360));
    row.points.push_back(point);
    row.lights.push_back(
        {direction_from_degrees(random.uniform(0, 90), random.uniform(0, 360)), {1, 1, 1}});
  }
  return row;
}

// |device - reference| of a value or an opacity: weights of directions within 2e-5, six of them,
// and sums of 40 terms. The mapping has slope W = 1 / T; and where O is positive the opacity is at
// most W m, so dividing by m and multiplying by it magnifies no more than that.
TEST(Opacity, DeviceAndReferenceAgree) {
  constexpr VisibilityMapping mapping{0.25, 4};
  const double tolerance = 2 * mapping.weight * (6 * 2e-5 + gamma(40, float_roundoff));
  const auto source = random_material({9, 8, 7, 6, 3});
  for (const std::size_t count : Sizes{1, 63, 64, 65, 300}) {
    const Row row = random_points(count);
    Job job;
    const auto on_device = shade(*make_shader(&shared_device(), source, job, mapping), row, job);
    const auto by_reference = shade(*make_shader(nullptr, source, job, mapping), row, job);
    for (std::size_t c = 0; c < 4; ++c) {
      std::vector<float> device_values;
      std::vector<float> reference_values;
      for (std::size_t i = 0; i < count; ++i) {
        device_values.push_back(on_device[i][c]);
        reference_values.push_back(by_reference[i][c]);
      }
      EXPECT_TRUE(all_near(device_values, reference_values, tolerance)) << count << ", " << c;
    }
  }
}

// A model of full ranks renders as the raw material does with its distances; one that holds its
// own mapping needs no other.
TEST(Opacity, ModelsOfMasksAreUsed) {
  const auto source = random_material({5, 4, 6, 6, 3});
  Job job;
  OcclusionRequest request;
  request.codec = &find_codec("tucker");
  request.storage = storage_request("f32");
  request.mapping = {0.25, 4};
  auto whole = find_codec("tucker").encode_reference(*source, {}, Storage::f32, job);
  whole->info.occlusion = compress_occlusion(nullptr, source->info(), request, job);
  whole->info.btf.mask.clear();
  whole->info.btf.mask_distance.clear();
  const std::shared_ptr<const Model> model = std::move(whole);
  const Row row = random_points(100);
  for (Device* device : both()) {
    const auto of_raw = shade(*make_shader(device, source, job, request.mapping), row, job);
    const auto of_model = shade(*make_shader(device, model, job), row, job);
    const auto sharper = shade(*make_shader(device, model, job, VisibilityMapping{0, 1}), row, job);
    std::size_t changed = 0;
    for (std::size_t i = 0; i < row.points.size(); ++i) {
      for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR(of_model[i][c], of_raw[i][c], 1e-3);
      changed += sharper[i][3] > of_model[i][3] + 0.01f ? 1 : 0;
    }
    EXPECT_GT(changed, 10u);
  }
}

}  // namespace
}  // namespace weft::test
