#include "weft/scene/environment_map.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/image.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

using std::numbers::pi;

std::vector<float> random_map(std::size_t rows, std::size_t columns, std::uint64_t seed) {
  return random_floats(3 * rows * columns, seed, 0, 2);
}

Vector3 at_angles(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

TEST(EnvironmentMap, LooksUpWhereItSays) {
  constexpr std::size_t rows = 4, columns = 8;
  std::vector<float> texels(3 * rows * columns);
  for (std::size_t i = 0; i < rows * columns; ++i) texels[3 * i] = static_cast<float>(i + 1);
  const EnvironmentMap map(rows, columns, texels, "map");
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const double theta = pi * (static_cast<double>(row) + 0.5) / rows;
      const double phi = pi - 2 * pi * (static_cast<double>(column) + 0.5) / columns;
      const float expected = texels[3 * (row * columns + column)];
      EXPECT_EQ(map.radiance(at_angles(theta, phi))[0], expected);
      EXPECT_NEAR(map.smooth_radiance(at_angles(theta, phi))[0], expected, 1e-5);
    }
  }
  // Half-way between two texels; over the seam; at the poles nothing but texels of the last row.
  EXPECT_NEAR(map.smooth_radiance(at_angles(pi * 1.5 / 4, pi / 2))[0], (10 + 11) / 2.0, 1e-5);
  EXPECT_NEAR(map.smooth_radiance(at_angles(pi * 1.5 / 4, pi))[0], (9 + 16) / 2.0, 1e-5);
  EXPECT_LE(map.smooth_radiance({0, 0, 1})[0], 8);
  EXPECT_GE(map.smooth_radiance({0, 0, -1})[0], 25);
}

// The density is that of the samples: over a grid of the unit square every texel is drawn as often
// as its power says, and 1 / density integrates to the solid angle of what is not black.
TEST(EnvironmentMap, DensityIsExact) {
  constexpr std::size_t rows = 6, columns = 5;
  std::vector<float> texels = random_map(rows, columns, 4);
  for (std::size_t c = 0; c < 3; ++c) texels[3 * 7 + c] = 0;
  const EnvironmentMap map(rows, columns, texels, "map");
  // The integral of the density over the sphere, by texels: each is constant.
  double total = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const double theta = pi * (static_cast<double>(row) + 0.5) / rows;
      const double phi = pi - 2 * pi * (static_cast<double>(column) + 0.5) / columns;
      const double solid_angle = (std::cos(pi * static_cast<double>(row) / rows) -
                                  std::cos(pi * static_cast<double>(row + 1) / rows)) *
                                 2 * pi / columns;
      total += map.density(at_angles(theta, phi)) * solid_angle;
    }
  }
  EXPECT_NEAR(total, 1, 1e-12);

  constexpr int n = 400;
  double power = 0, area = 0;
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < n; ++k) {
      const EnvironmentSample sample = map.sample({(i + 0.5) / n, (k + 0.5) / n});
      EXPECT_NEAR(length(sample.direction), 1, 1e-12);
      EXPECT_EQ(sample.radiance, map.radiance(sample.direction));
      EXPECT_NEAR(sample.density, map.density(sample.direction), 1e-12);
      EXPECT_GT(sample.density, 0);
      power += sample.radiance[1] / sample.density / (n * n);
      area += 1 / sample.density / (n * n);
    }
  }
  // The midpoint rule over n x n points cuts a cell at most along each of rows + columns edges:
  // 11/400 of the points are off by at most the spread of the values.
  const double black = (std::cos(pi / 6) - std::cos(pi / 3)) * 2 * pi / 5;
  EXPECT_NEAR(area, 4 * pi - black, 4 * pi * 11 / n);
  double expected = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      expected += texels[3 * (row * columns + column) + 1] *
                  (std::cos(pi * static_cast<double>(row) / rows) -
                   std::cos(pi * static_cast<double>(row + 1) / rows)) *
                  2 * pi / columns;
    }
  }
  EXPECT_NEAR(power, expected, expected * 11 / n);
}

// Of one bright texel every sample is drawn, and the estimate of the irradiance has no noise but
// that of the cosine within the texel.
TEST(EnvironmentMap, FindsTheOneBrightTexel) {
  constexpr std::size_t rows = 64, columns = 128;
  std::vector<float> texels(3 * rows * columns);
  constexpr std::size_t row = 10, column = 77;
  for (std::size_t c = 0; c < 3; ++c) texels[3 * (row * columns + column) + c] = 1000;
  const EnvironmentMap map(rows, columns, texels, "map");
  const double top = std::cos(pi * row / rows), bottom = std::cos(pi * (row + 1) / rows);
  const double solid_angle = (top - bottom) * 2 * pi / columns;
  for (const double x : {0.0, 0.3, 0.999999}) {
    for (const double y : {0.0, 0.5, std::nextafter(1.0, 0.0)}) {
      const EnvironmentSample sample = map.sample({x, y});
      EXPECT_EQ(sample.radiance[0], 1000);
      EXPECT_NEAR(sample.density, 1 / solid_angle, 1e-9 / solid_angle);
      EXPECT_GE(sample.direction[2], bottom - 1e-12);
      EXPECT_LE(sample.direction[2], top + 1e-12);
    }
  }
}

TEST(EnvironmentMap, OfNoLightGivesNone) {
  const EnvironmentMap map(3, 4, std::vector<float>(36), "map");
  EXPECT_EQ(map.sample({0.5, 0.5}).density, 0);
  EXPECT_EQ(map.density({0, 0, 1}), 0);
  const EnvironmentMap negative(1, 1, {-1, -2, -3}, "map");
  EXPECT_EQ(negative.radiance({1, 0, 0}), (std::array<float, 3>{0, 0, 0}));
}

TEST(EnvironmentMap, RefusesBadTexels) {
  expect_error(ErrorKind::input, {"map", "2 x 1", "5"},
               [] { EnvironmentMap(1, 2, std::vector<float>(5), "map"); });
  expect_error(ErrorKind::input, {"map", "0"}, [] { EnvironmentMap(0, 2, {}, "map"); });
  std::vector<float> texels(18, 1.0f);
  texels[13] = std::numeric_limits<float>::quiet_NaN();
  expect_error(ErrorKind::input, {"map", "row 1, column 1", "nan"},
               [&] { EnvironmentMap(2, 3, texels, "map"); });
  // What it lights would be infinite.
  texels[13] = 2e20f;
  expect_error(ErrorKind::input, {"map", "row 1, column 1", "2e+20", "1e+20"},
               [&] { EnvironmentMap(2, 3, texels, "map"); });
}

TEST(EnvironmentMap, IsReadFromExr) {
  const TemporaryFolder folder;
  const std::vector<float> texels = random_map(4, 6, 9);
  const ImageInfo info{4, 6, 3, DType::f32};
  write_exr(folder / "map.exr", info, std::as_bytes(std::span(texels)), ExrCompression::zip);
  const EnvironmentMap map = read_environment_map(folder / "map.exr");
  EXPECT_EQ(map.rows(), 4u);
  EXPECT_EQ(map.columns(), 6u);
  EXPECT_EQ(map.radiance(at_angles(pi / 8, pi - pi / 6))[2], texels[2]);
  const std::vector<std::byte> grey(24);
  write_png(folder / "map.png", {4, 2, 3, DType::u8}, grey);
  expect_error(ErrorKind::input, {"map.png", "EXR"},
               [&] { read_environment_map(folder / "map.png"); });
}

}  // namespace
}  // namespace weft::test
