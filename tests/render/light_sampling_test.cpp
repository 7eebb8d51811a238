// Environments sampled by their light, by the material and by both: the same picture as by
// quadrature, with the noise that each way should leave.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/render/shade.hpp"
#include "weft/scene/hemisphere_chart.hpp"
#include "weft/scene/light_tables.hpp"
#include "weft/scene/ray_caster.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

constexpr double pi = std::numbers::pi;
constexpr std::size_t map_rows = 8, map_columns = 16;

// Matt with a highlight about the mirror direction, sharper from texel to texel.
std::shared_ptr<MemorySource> glossy_source(Quantity quantity, double sharpness) {
  constexpr BtfShape shape{37, 61, 4, 4, 3};
  BtfInfo info = make_info(shape);
  info.quantity = quantity;
  std::vector<double> values;
  for (const Direction& v : info.view_directions) {
    for (const Direction& l : info.light_directions) {
      const double mirror = double{v[2] * l[2]} - double{v[0] * l[0]} - double{v[1] * l[1]};
      const double cosine = quantity == Quantity::brdf ? 1 : double{l[2]};
      for (std::size_t texel = 0; texel < shape.texels(); ++texel) {
        const double power = sharpness * (1 + static_cast<double>(texel % 3));
        const double gloss = std::pow(std::max(mirror, 0.0), power) * power / 4;
        for (std::size_t c = 0; c < 3; ++c) {
          values.push_back(cosine * (0.02 + gloss) * (1 + 0.2 * static_cast<double>(c)));
        }
      }
    }
  }
  return std::make_shared<MemorySource>(info, encode_values(values, DType::f32));
}

// Dim everywhere, with one texel of that radiance.
std::shared_ptr<const EnvironmentMap> map_with(float bright) {
  std::vector<float> texels = random_floats(3 * map_rows * map_columns, 5, 0.2, 1);
  for (std::size_t c = 0; c < 3; ++c) texels[3 * (2 * map_columns + 5) + c] = bright;
  return std::make_shared<EnvironmentMap>(map_rows, map_columns, std::move(texels), "map");
}

Scene plane_scene(std::shared_ptr<const EnvironmentMap> map, std::size_t samples) {
  Scene scene;
  scene.camera = camera_at_degrees(50, 250, 6);
  scene.camera.width = 5;
  scene.camera.height = 4;
  scene.camera.field_of_view = 8;  // nothing but the plane
  scene.shape = make_plane({0.7, 0.7});
  scene.environment.map = std::move(map);
  scene.environment.samples = samples;
  scene.environment.rotation = 30;
  return scene;
}

std::vector<PointRadiance> shade(Shader& shader, const PixelBatch& batch) {
  std::vector<PointRadiance> radiance(batch.points.size());
  Job job;
  shader.shade(batch.points, batch.lights, radiance, job);
  return radiance;
}

double luminance(const PointRadiance& point) {
  return slice_luminance(std::array{double{point[0]}, double{point[1]}, double{point[2]}});
}

// Mean and variance of one picture's pixels, over pictures of different samples.
struct Estimates {
  std::vector<double> means, variances;

  double mean_variance() const {
    double sum = 0;
    for (const double variance : variances) sum += variance;
    return sum / static_cast<double>(variances.size());
  }
};

Estimates estimate(Scene scene, LightSampling sampling, Shader& shader, std::size_t pictures) {
  scene.environment.sampling = sampling;
  Job job;
  scene.environment.material =
      std::make_shared<const LightTables>(shader.light_tables(job.memory, job));
  std::vector<double> sums(scene.camera.width * scene.camera.height), squares(sums.size());
  for (std::size_t seed = 1; seed <= pictures; ++seed) {
    scene.seed = seed;
    const RayCaster caster(scene, 1);
    PixelBatch batch;
    caster.cast(0, caster.pixels(), batch);
    EXPECT_EQ(batch.points.size(), sums.size());
    const std::vector<PointRadiance> radiance = shade(shader, batch);
    for (std::size_t i = 0; i < sums.size(); ++i) {
      sums[i] += luminance(radiance[i]);
      squares[i] += luminance(radiance[i]) * luminance(radiance[i]);
    }
  }
  Estimates result;
  const auto n = static_cast<double>(pictures);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    result.means.push_back(sums[i] / n);
    result.variances.push_back((squares[i] - sums[i] * sums[i] / n) / (n - 1));
  }
  return result;
}

// The same by the midpoint rule over `points` x `points` of each of the map's texels.
std::vector<double> by_quadrature(const Scene& scene, Shader& shader, std::size_t points) {
  Scene dark = scene;
  dark.environment.sampling = LightSampling::light;
  const RayCaster caster(dark, 1);
  PixelBatch batch;
  caster.cast(0, caster.pixels(), batch);
  batch.lights.clear();
  const std::size_t rows = map_rows / 2 * points, columns = map_columns * points;
  const double turn = scene.environment.rotation * pi / 180;
  for (const ShadingPoint& point : batch.points) {
    for (std::size_t i = 0; i < rows; ++i) {
      const double top = pi / 2 * static_cast<double>(i) / static_cast<double>(rows);
      const double bottom = pi / 2 * static_cast<double>(i + 1) / static_cast<double>(rows);
      const double z = (std::cos(top) + std::cos(bottom)) / 2, radius = std::sqrt(1 - z * z);
      const double solid_angle =
          (std::cos(top) - std::cos(bottom)) * 2 * pi / static_cast<double>(columns);
      for (std::size_t k = 0; k < columns; ++k) {
        const double phi =
            pi - 2 * pi * (static_cast<double>(k) + 0.5) / static_cast<double>(columns);
        const Vector3 in_map{radius * std::cos(phi), radius * std::sin(phi), z};
        const Vector3 world{radius * std::cos(phi + turn), radius * std::sin(phi + turn), z};
        const auto axis = [](const std::array<float, 3>& a) {
          return Vector3{double{a[0]}, double{a[1]}, double{a[2]}};
        };
        LightSample light;
        light.direction =
            to_float({dot(world, axis(point.tangent)), dot(world, axis(point.bitangent)),
                      dot(world, axis(point.normal))});
        const std::array<float, 3> seen = scene.environment.map->radiance(in_map);
        for (std::size_t c = 0; c < 3; ++c) {
          light.irradiance[c] = static_cast<float>(double{seen[c]} * solid_angle);
        }
        batch.lights.push_back(light);
      }
    }
  }
  std::vector<double> values;
  for (const PointRadiance& point : shade(shader, batch)) values.push_back(luminance(point));
  return values;
}

constexpr LightSampling every_way[] = {LightSampling::light, LightSampling::material,
                                       LightSampling::both};

// Means of many pictures lie within 5 standard errors of the quadrature, whose own error is taken
// from twice as fine a one.
TEST(LightSampling, EveryWayGivesTheSamePicture) {
  constexpr std::size_t pictures = 150;
  for (const Quantity quantity : {Quantity::radiance, Quantity::brdf}) {
    const auto source = glossy_source(quantity, 6);
    Job job;
    const auto shader = make_shader(&shared_device(), source, job);
    const auto reference = make_shader(nullptr, source, job);
    for (const float bright : {1.0f, 60.0f}) {
      const Scene scene = plane_scene(map_with(bright), 7);
      const std::vector<double> coarse = by_quadrature(scene, *shader, 8);
      const std::vector<double> expected = by_quadrature(scene, *shader, 16);
      for (const LightSampling way : every_way) {
        for (Shader* const one : {shader.get(), reference.get()}) {
          SCOPED_TRACE(testing::Message()
                       << name_of(quantity) << ", " << bright << ", way " << static_cast<int>(way)
                       << (one == shader.get() ? " on the device" : " by the reference"));
          const Estimates found = estimate(scene, way, *one, pictures);
          for (std::size_t i = 0; i < expected.size(); ++i) {
            const double error = 5 * std::sqrt(found.variances[i] / pictures);
            EXPECT_LT(error, 0.4 * expected[i]);
            EXPECT_NEAR(found.means[i], expected[i], error + std::abs(expected[i] - coarse[i]))
                << "pixel " << i;
          }
        }
      }
    }
  }
}

// Models of all directions too, whose tables of slices are of measured ones.
TEST(LightSampling, EveryWayGivesTheSamePictureOfModelsOfAllDirections) {
  constexpr std::size_t pictures = 100;
  const std::shared_ptr<const Model> model = std::make_shared<VqModel>(
      random_vq({19, 23, 4, 4, 3}, {VqGrid::Kind::onion, {8, 4, 5, 6}}, small_sizes, 2));
  Job job;
  const auto shader = make_shader(&shared_device(), model, job);
  const Scene scene = plane_scene(map_with(1), 7);
  const std::vector<double> coarse = by_quadrature(scene, *shader, 8);
  const std::vector<double> expected = by_quadrature(scene, *shader, 16);
  for (const LightSampling way : every_way) {
    SCOPED_TRACE(testing::Message() << "way " << static_cast<int>(way));
    const Estimates found = estimate(scene, way, *shader, pictures);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const double error = 5 * std::sqrt(found.variances[i] / pictures);
      EXPECT_LT(error, 0.2 * expected[i]);
      EXPECT_NEAR(found.means[i], expected[i], error + std::abs(expected[i] - coarse[i]))
          << "pixel " << i;
    }
  }
}

// Of a sharp highlight in even light, the material's samples leave least noise; of a matt material
// with one bright light, the light's; both together are better than the worse of them either time.
TEST(LightSampling, EachWayIsGoodWhereItShouldBe) {
  Job job;
  const auto glossy = make_shader(&shared_device(), glossy_source(Quantity::radiance, 40), job);
  const auto matt = make_shader(&shared_device(), glossy_source(Quantity::radiance, 1), job);
  const auto noise = [](Shader& shader, float bright, LightSampling way) {
    return estimate(plane_scene(map_with(bright), 16), way, shader, 40).mean_variance();
  };
  const double glossy_light = noise(*glossy, 1, LightSampling::light);
  const double glossy_material = noise(*glossy, 1, LightSampling::material);
  const double glossy_both = noise(*glossy, 1, LightSampling::both);
  EXPECT_LT(4 * glossy_material, glossy_light);
  EXPECT_LT(glossy_both, glossy_light);
  const double matt_light = noise(*matt, 1000, LightSampling::light);
  const double matt_material = noise(*matt, 1000, LightSampling::material);
  const double matt_both = noise(*matt, 1000, LightSampling::both);
  EXPECT_LT(4 * matt_light, matt_material);
  EXPECT_LT(4 * matt_both, matt_material);
}

TEST(LightTables, DeviceAndReferenceAgree) {
  const auto source = glossy_source(Quantity::brdf, 3);
  Job job;
  const LightTables device =
      make_shader(&shared_device(), source, job)->light_tables(job.memory, job);
  const LightTables reference = make_shader(nullptr, source, job)->light_tables(job.memory, job);
  EXPECT_EQ(device.bytes(), reference.bytes());
  EXPECT_EQ(device.bytes(), LightTables::bytes(source->info(), 0));
  Random random(3);
  for (int i = 0; i < 200; ++i) {
    const std::array<float, 2> uv{static_cast<float>(random.uniform()),
                                  static_cast<float>(random.uniform())};
    const auto view = direction_from_degrees(random.uniform(0, 90), random.uniform(0, 360));
    const Vector3 light = hemisphere_of_square({random.uniform(), random.uniform()});
    const double expected = light_density(reference.density(uv, view), light);
    // values are those of the source, which both round once to float
    EXPECT_NEAR(light_density(device.density(uv, view), light), expected, 1e-5 * (expected + 1));
  }
}

TEST(LightTables, TakeTheLevelThatFits) {
  BtfInfo info = make_info({10, 20, 128, 64, 3});
  const std::size_t levels = mip_levels(info.shape);
  const std::size_t level = LightTables::choose_level(info, levels, std::size_t{1} << 40);
  EXPECT_EQ(level, 3u);  // 16 x 8 texels: 32 x 16 are more than 256
  const std::size_t bytes = LightTables::bytes(info, level);
  EXPECT_EQ(LightTables::choose_level(info, levels, bytes), level);
  EXPECT_EQ(LightTables::choose_level(info, levels, bytes - 1), level + 1);
  EXPECT_EQ(LightTables::choose_level(info, levels, 0), levels - 1);
}

TEST(LightSampling, RefusesAMaterialWithoutTables) {
  Scene scene = plane_scene(map_with(1), 4);
  scene.environment.sampling = LightSampling::both;
  expect_error(ErrorKind::input, {"scene", "tables"}, [&] { validate(scene); });
  expect_error(ErrorKind::input, {"--sampling", "bright", "light, material, both"},
               [] { light_sampling_from_name("bright", "--sampling"); });
}

}  // namespace
}  // namespace weft::test
