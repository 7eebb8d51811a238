#include "weft/scene/ray_caster.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

using std::numbers::pi;

Scene small_scene(std::shared_ptr<const Shape> shape) {
  Scene scene;
  scene.camera = camera_at_degrees(60, 250, 4);
  scene.camera.width = 24;
  scene.camera.height = 16;
  scene.shape = std::move(shape);
  scene.lights = {light_at_degrees(30, 45, {1, 2, 3})};
  return scene;
}

std::shared_ptr<const EnvironmentMap> constant_map(float value) {
  return std::make_shared<EnvironmentMap>(8, 16, std::vector<float>(3 * 8 * 16, value), "constant");
}

PixelBatch cast_all(const RayCaster& caster) {
  PixelBatch batch;
  caster.cast(0, caster.pixels(), batch);
  return batch;
}

bool same_points(const PixelBatch& a, const PixelBatch& b) {
  if (a.points.size() != b.points.size() || a.lights.size() != b.lights.size()) return false;
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    const ShadingPoint &p = a.points[i], &q = b.points[i];
    if (p.pixel != q.pixel || p.uv != q.uv || p.footprint != q.footprint || p.view != q.view ||
        p.position != q.position || p.tangent != q.tangent || p.normal != q.normal) {
      return false;
    }
  }
  for (std::size_t i = 0; i < a.lights.size(); ++i) {
    if (a.lights[i].direction != b.lights[i].direction ||
        a.lights[i].irradiance != b.lights[i].irradiance) {
      return false;
    }
  }
  return a.background == b.background;
}

TEST(Camera, LooksAtItsTarget) {
  Camera camera;
  camera.eye = {3, -2, 1};
  camera.target = {0.5, 0.25, -1};
  camera.width = 40;
  camera.height = 30;
  const CameraRays rays(camera);
  const Ray middle = rays.at(20, 15);
  EXPECT_NEAR(length(cross(middle.direction, difference(camera.target, camera.eye))), 0, 1e-12);
  // The shorter side spans the field of view; right is right and down is down.
  const Vector3 top = rays.at(20, 0).direction, bottom = rays.at(20, 30).direction;
  EXPECT_NEAR(std::acos(dot(top, bottom)), camera.field_of_view * pi / 180, 1e-12);
  EXPECT_GT(top[2], bottom[2]);
  const Vector3 right = difference(rays.at(40, 15).direction, rays.at(0, 15).direction);
  EXPECT_GT(dot(cross(middle.direction, {0, 0, 1}), right), 0);
  // From straight above, +y is up.
  const CameraRays above(camera_at_degrees(0, 0, 4));
  EXPECT_GT(above.at(256, 0).direction[1], 0.1);
  EXPECT_GT(above.at(512, 256).direction[0], 0.1);
}

TEST(Camera, RefusesWhatSeesNothing) {
  Camera camera;
  camera.eye = camera.target;
  expect_error(ErrorKind::input, {"eye and target"}, [&] { validate(camera); });
  camera = {};
  camera.field_of_view = 180;
  expect_error(ErrorKind::input, {"field of view", "180"}, [&] { validate(camera); });
  camera = {};
  camera.width = 0;
  expect_error(ErrorKind::input, {"0 x 512"}, [&] { validate(camera); });
  camera = {};
  camera.eye[1] = NAN;
  expect_error(ErrorKind::input, {"eye", "nan"}, [&] { validate(camera); });
}

TEST(PixelSamples, AreSpreadRoundTheCentre) {
  EXPECT_EQ(pixel_sample(0, 1), (std::array<double, 2>{0.5, 0.5}));
  for (const std::size_t count : {2u, 3u, 4u, 16u, 17u}) {
    std::vector<bool> column(count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto [x, y] = pixel_sample(i, count);
      EXPECT_GT(y, 0);
      EXPECT_LT(y, 1);
      column[static_cast<std::size_t>(x * static_cast<double>(count))] = true;
    }
    EXPECT_EQ(std::count(column.begin(), column.end(), true), static_cast<std::ptrdiff_t>(count));
  }
}

TEST(RayCaster, FillsEveryPixel) {
  Scene scene = small_scene(make_sphere({2, 2}));
  scene.samples = 4;
  scene.background = {0.25, 0.5, 1};
  const RayCaster caster(scene, 1);
  const PixelBatch batch = cast_all(caster);
  ASSERT_EQ(batch.background.size(), caster.pixels());
  ASSERT_EQ(batch.lights.size(), batch.points.size());
  std::vector<double> covered(caster.pixels());
  std::uint32_t before = 0;
  for (const ShadingPoint& point : batch.points) {
    EXPECT_GE(point.pixel, before);
    before = point.pixel;
    covered[point.pixel] += point.weight;
    EXPECT_GT(point.view[2], 0);
    EXPECT_GE(point.uv[0], 0);
    EXPECT_LT(point.uv[0], 1);
    EXPECT_GE(point.footprint[0], point.footprint[1]);
    EXPECT_EQ(point.behind, (std::array<float, 3>{0.25f, 0.5f, 1.0f}));
  }
  for (std::size_t i = 0; i < covered.size(); ++i) {
    EXPECT_EQ(covered[i], batch.background[i][3]);
    EXPECT_EQ((1 - covered[i]) * 0.5, batch.background[i][1]);
  }
  EXPECT_EQ(batch.background[0][3], 0);
  EXPECT_EQ(batch.background[caster.pixels() / 2 + 12][3], 1);
}

TEST(RayCaster, IgnoresThreadsAndBatches) {
  Scene scene = small_scene(make_sphere({2, 2}));
  scene.camera.width = 100;
  scene.camera.height = 90;
  scene.environment.map = constant_map(1);
  scene.environment.samples = 3;
  const PixelBatch all = cast_all(RayCaster(scene, 1));
  EXPECT_TRUE(same_points(all, cast_all(RayCaster(scene, 3))));
  const RayCaster caster(scene, 2);
  PixelBatch joined, part;
  for (std::size_t first = 0; first < caster.pixels(); first += 777) {
    caster.cast(first, std::min<std::size_t>(777, caster.pixels() - first), part);
    joined.points.insert(joined.points.end(), part.points.begin(), part.points.end());
    joined.lights.insert(joined.lights.end(), part.lights.begin(), part.lights.end());
    joined.background.insert(joined.background.end(), part.background.begin(),
                             part.background.end());
  }
  EXPECT_TRUE(same_points(all, joined));
  const std::size_t bytes =
      all.points.size() * sizeof(ShadingPoint) + all.lights.size() * sizeof(LightSample);
  EXPECT_LE(bytes, caster.bytes_per_pixel() * caster.pixels());
}

// On a plane the frame is the world's, so that directions come out as they went in.
TEST(RayCaster, PlaneKeepsDirections) {
  Scene scene = small_scene(make_plane({3, 3}));
  scene.lights.push_back(light_at_degrees(120, 0, {1, 1, 1}));
  const PixelBatch batch = cast_all(RayCaster(scene));
  ASSERT_GT(batch.points.size(), 50u);
  for (std::size_t i = 0; i < batch.points.size(); ++i) {
    const ShadingPoint& point = batch.points[i];
    const Vector3 to_eye = normalized(
        difference(scene.camera.eye, {point.position[0], point.position[1], point.position[2]}));
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(point.view[c], to_eye[c], 1e-6);
      EXPECT_NEAR(batch.lights[2 * i].direction[c], scene.lights[0].direction[c], 1e-6);
    }
    EXPECT_EQ(batch.lights[2 * i].irradiance, (std::array<float, 3>{1, 2, 3}));
    // A light below the horizon gives nothing.
    EXPECT_EQ(batch.lights[2 * i + 1].irradiance, (std::array<float, 3>{0, 0, 0}));
    EXPECT_LT(batch.lights[2 * i + 1].direction[2], 0);
  }
}

// Straight from above, a pixel covers the same square everywhere.
TEST(RayCaster, FootprintIsThePixelOnThePlane) {
  Scene scene = small_scene(make_plane({5, 10}));
  scene.camera = camera_at_degrees(0, 0, 4);
  scene.camera.width = scene.camera.height = 32;
  const double pixel = 2 * 4 * std::tan(scene.camera.field_of_view * pi / 360) / 32;
  const std::size_t samples = 4;
  scene.samples = samples;
  for (const ShadingPoint& point : cast_all(RayCaster(scene)).points) {
    // 10 tiles over 2 units; half a pixel per sample along each axis.
    EXPECT_NEAR(point.footprint[0], pixel * 5 / 2, 1e-6);
    EXPECT_NEAR(point.footprint[1], pixel * 2.5 / 2, 1e-6);
  }
}

// A map of constant radiance L gives the irradiance pi L on every side of a convex body.
TEST(RayCaster, ConstantEnvironmentGivesPiTimesItsRadiance) {
  Scene scene = small_scene(make_sphere({2, 2}));
  scene.lights.clear();
  scene.environment.map = constant_map(3);
  scene.environment.scale = 0.5;
  scene.environment.samples = 256;
  const PixelBatch batch = cast_all(RayCaster(scene));
  double mean = 0;
  for (std::size_t i = 0; i < batch.points.size(); ++i) {
    double irradiance = 0;
    for (std::size_t s = 0; s < 256; ++s) {
      const LightSample& light = batch.lights[256 * i + s];
      irradiance += double{light.irradiance[1]} * light.direction[2];
    }
    // 256 well spread samples of a cosine.
    EXPECT_NEAR(irradiance, pi * 1.5, 0.1 * pi);
    mean += irradiance / static_cast<double>(batch.points.size());
  }
  // Unbiased: independent offsets average out. A plain Monte Carlo estimate of 4 pi L max(cos, 0)
  // has a variance of (4 pi L)^2 (1/6 - 1/16) per sample; 5 standard deviations of the mean.
  const double deviation = 4 * pi * 1.5 * std::sqrt(1.0 / 6 - 1.0 / 16) /
                           std::sqrt(256.0 * static_cast<double>(batch.points.size()));
  EXPECT_NEAR(mean, pi * 1.5, 5 * deviation);
}

// The points of a pixel share its samples: their mean varies less from pixel to pixel than means of
// points that know nothing of each other would.
TEST(RayCaster, PointsOfAPixelShareTheEnvironment) {
  Scene scene = small_scene(make_plane({1, 1}));
  scene.camera = camera_at_degrees(10, 0, 1);  // the plane fills the picture
  scene.camera.width = scene.camera.height = 48;
  scene.lights.clear();
  scene.environment.map = constant_map(1);
  constexpr std::size_t samples = 4, lights = 16;
  scene.samples = samples;
  scene.environment.samples = lights;
  const RayCaster caster(scene);
  const PixelBatch batch = cast_all(caster);
  ASSERT_EQ(batch.points.size(), samples * caster.pixels());
  double sum = 0, point_squares = 0, pixel_squares = 0;
  for (std::size_t pixel = 0; pixel < caster.pixels(); ++pixel) {
    double mean = 0;
    for (std::size_t s = 0; s < samples; ++s) {
      double irradiance = 0;
      for (std::size_t k = 0; k < lights; ++k) {
        const LightSample& light = batch.lights[(pixel * samples + s) * lights + k];
        irradiance += double{light.irradiance[1]} * light.direction[2];
      }
      point_squares += irradiance * irradiance / samples;
      mean += irradiance / samples;
    }
    sum += mean;
    pixel_squares += mean * mean;
  }
  const auto n = static_cast<double>(caster.pixels());
  const double square = sum / n * sum / n;
  EXPECT_LT(pixel_squares / n - square, 0.6 * (point_squares / n - square) / samples);
}

// One bright texel is a directional light, wherever the map is turned.
TEST(RayCaster, BrightTexelIsALight) {
  std::vector<float> texels(3 * 64 * 128);
  for (std::size_t c = 0; c < 3; ++c) texels[3 * (12 * 128 + 40) + c] = static_cast<float>(c + 1);
  const auto map = std::make_shared<EnvironmentMap>(64, 128, texels, "texel");
  const double theta = pi * 12.5 / 64, phi = pi - 2 * pi * 40.5 / 128;
  const double solid_angle = (std::cos(pi * 12 / 64) - std::cos(pi * 13 / 64)) * 2 * pi / 128;
  Scene scene = small_scene(make_plane({1, 1}));
  scene.lights.clear();
  scene.environment.map = map;
  scene.environment.samples = 4;
  for (const double rotation : {0.0, 35.0, -200.0}) {
    scene.environment.rotation = rotation;
    const DirectionalLight light =
        light_at_degrees(theta * 180 / pi, phi * 180 / pi + rotation, {1, 1, 1});
    const PixelBatch batch = cast_all(RayCaster(scene));
    for (std::size_t i = 0; i < batch.points.size(); ++i) {
      double sum = 0;
      for (std::size_t s = 0; s < 4; ++s) {
        const LightSample& sample = batch.lights[4 * i + s];
        sum += sample.irradiance[2];
        double cosine = 0;
        for (std::size_t c = 0; c < 3; ++c) cosine += sample.direction[c] * light.direction[c];
        EXPECT_GT(cosine, std::cos(0.04));  // half the diagonal of a texel: pi / 64 / sqrt(2)
      }
      EXPECT_NEAR(sum, 3 * solid_angle, 1e-5 * solid_angle);
    }
  }
}

TEST(RayCaster, ShowsTheEnvironmentBehind) {
  Scene scene = small_scene(make_sphere({1, 1}));
  std::vector<float> texels(3 * 2 * 4);
  for (std::size_t i = 0; i < 12; ++i) texels[i] = 2;  // the upper half
  scene.environment.map = std::make_shared<EnvironmentMap>(2, 4, texels, "halves");
  scene.environment.samples = 1;
  scene.environment.scale = 3;
  scene.show_environment = true;
  scene.camera = camera_at_degrees(90, 0, 4);
  scene.camera.field_of_view = 120;
  scene.camera.width = scene.camera.height = 16;
  const PixelBatch batch = cast_all(RayCaster(scene));
  EXPECT_GT(batch.background[0][0], 4);
  EXPECT_LT(batch.background[15 * 16][0], 2);
}

TEST(Scene, IsValidated) {
  const auto expect_refused = [](std::initializer_list<std::string_view> parts,
                                 const auto& change) {
    Scene scene = small_scene(make_plane({1, 1}));
    change(scene);
    expect_error(ErrorKind::input, parts, [&] { RayCaster{scene}; });
  };
  expect_refused({"no shape"}, [](Scene& s) { s.shape = nullptr; });
  expect_refused({"samples per pixel", "0"}, [](Scene& s) { s.samples = 0; });
  expect_refused({"lights of a point", "0"}, [](Scene& s) { s.lights.clear(); });
  expect_refused({"light 0", "unit"}, [](Scene& s) { s.lights[0].direction = {1, 1, 1}; });
  expect_refused({"light 0", "-1"}, [](Scene& s) { s.lights[0].irradiance[1] = -1; });
  expect_refused({"background", "nan"}, [](Scene& s) { s.background[2] = NAN; });
  expect_refused({"environment", "65537"}, [](Scene& s) {
    s.environment.map = constant_map(1);
    s.environment.samples = 65537;
  });
  expect_refused({"rotation", "inf"}, [](Scene& s) {
    s.environment.map = constant_map(1);
    s.environment.rotation = INFINITY;
  });
  const RayCaster caster(small_scene(make_plane({1, 1})));
  PixelBatch batch;
  expect_error(ErrorKind::input, {"pixels", "384"}, [&] { caster.cast(380, 5, batch); });
  caster.cast(384, 0, batch);
  EXPECT_TRUE(batch.points.empty());
}

}  // namespace
}  // namespace weft::test
