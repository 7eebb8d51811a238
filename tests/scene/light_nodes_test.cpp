// Densities over the hemisphere that directions are drawn from, against quadrature.
#include "weft/scene/light_nodes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "support/generators.hpp"
#include "weft/scene/hemisphere_chart.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

constexpr double pi = std::numbers::pi;

TEST(HemisphereChart, IsOneToOne) {
  Random random(1);
  for (int i = 0; i < 2000; ++i) {
    const std::array<double, 2> place{random.uniform(), random.uniform()};
    const Vector3 d = hemisphere_of_square(place);
    EXPECT_NEAR(length(d), 1, 1e-14);
    const std::array<double, 2> back = square_of_hemisphere(d);
    EXPECT_NEAR(back[0], place[0], 1e-13);
    EXPECT_NEAR(back[1], place[1], 1e-13);
  }
  // the pole, the edge and the corners
  EXPECT_EQ(hemisphere_of_square({0.5, 0.5}), (Vector3{0, 0, 1}));
  EXPECT_EQ(square_of_hemisphere({0, 0, 1}), (std::array<double, 2>{0.5, 0.5}));
  for (const double a : {0.0, 1.0}) {
    for (const double b : {0.0, 0.3, 1.0}) {
      for (const auto& place : {std::array{a, b}, std::array{b, a}}) {
        const Vector3 d = hemisphere_of_square(place);
        EXPECT_NEAR(d[2], 0, 1e-15);
        const std::array<double, 2> back = square_of_hemisphere(d);
        EXPECT_NEAR(back[0], place[0], 1e-15);
        EXPECT_NEAR(back[1], place[1], 1e-15);
      }
    }
  }
}

// Means over the square are means over the hemisphere: of z 1/2, of x^2, y^2 and z^2 1/3, of x and
// of x y 0; within the midpoint rule's error, second differences over 24.
TEST(HemisphereChart, KeepsAreas) {
  constexpr int n = 400;
  double z = 0, xx = 0, yy = 0, x = 0, xy = 0;
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < n; ++k) {
      const Vector3 d = hemisphere_of_square({(i + 0.5) / n, (k + 0.5) / n});
      z += d[2] / (n * n);
      xx += d[0] * d[0] / (n * n);
      yy += d[1] * d[1] / (n * n);
      x += d[0] / (n * n);
      xy += d[0] * d[1] / (n * n);
    }
  }
  EXPECT_NEAR(z, 0.5, 1e-5);
  EXPECT_NEAR(xx, 1.0 / 3, 1e-5);
  EXPECT_NEAR(yy, 1.0 / 3, 1e-5);
  EXPECT_NEAR(x, 0, 1e-12);
  EXPECT_NEAR(xy, 0, 1e-12);
}

TEST(HemisphereChart, IsContinuous) {
  // across the diagonals, along which the two halves of the map meet, and everywhere else
  constexpr double step = 1e-7;
  Random random(2);
  for (int i = 0; i < 1000; ++i) {
    const double a = random.uniform(step, 1 - step);
    const double b = i % 3 == 0 ? a : i % 3 == 1 ? 1 - a : random.uniform(step, 1 - step);
    const Vector3 d = hemisphere_of_square({a, b});
    for (const auto& place : {std::array{a + step, b}, std::array{a, b - step}}) {
      // d / d radius is at most 2 long, d / d angle 1 with pi / 4 (1 + |b| / |a|) of it in the
      // corners, and a and b go through [-1, 1]: sqrt(16 + pi^2 / 4) in all
      EXPECT_LT(length(difference(hemisphere_of_square(place), d)), 5 * step);
    }
  }
}

// F is bilinear in half cells, over which the midpoint rule is exact.
double integral(const BilinearDensity& density, std::size_t rows, std::size_t columns,
                double up_to_row = 1) {
  double sum = 0;
  const auto n = 2 * rows, m = 2 * columns;
  for (std::size_t i = 0; i < n; ++i) {
    const double low = static_cast<double>(i) / static_cast<double>(n);
    const double high = std::min(up_to_row, static_cast<double>(i + 1) / static_cast<double>(n));
    if (high <= low) break;
    for (std::size_t k = 0; k < m; ++k) {
      const double across = (static_cast<double>(k) + 0.5) / static_cast<double>(m);
      sum += density.at({(low + high) / 2, across}) * (high - low) / static_cast<double>(m);
    }
  }
  return sum;
}

TEST(BilinearDensity, IntegratesToOne) {
  for (const auto& [rows, columns] :
       {std::pair<std::size_t, std::size_t>{1, 1}, {1, 5}, {4, 1}, {7, 9}}) {
    const BilinearDensity density(rows, columns, random_values(rows * columns, 3));
    EXPECT_NEAR(integral(density, rows, columns), 1, 1e-14);
  }
  std::vector<double> spike(13 * 13);
  spike[13 * 4 + 9] = 1e30;
  EXPECT_NEAR(integral(BilinearDensity(13, 13, spike), 13, 13), 1, 1e-13);
}

// The number a place was drawn with is the share of the density before it.
TEST(BilinearDensity, InvertsItsIntegral) {
  constexpr std::size_t rows = 5, columns = 8;
  std::vector<double> holes = random_values(rows * columns, 5);
  for (std::size_t i = 0; i < holes.size(); i += 3) holes[i] = 0;
  for (const auto& nodes : {random_values(rows * columns, 4), holes}) {
    const BilinearDensity density(rows, columns, nodes);
    Random random(6);
    for (int i = 0; i < 500; ++i) {
      const std::array<double, 2> numbers{random.uniform(), random.uniform()};
      const SquareSample drawn = density.sample(numbers);
      EXPECT_EQ(drawn.density, density.at(drawn.place));
      EXPECT_NEAR(integral(density, rows, columns, drawn.place[0]), numbers[0], 1e-12);
      // along the row
      double before = 0, all = 0;
      for (std::size_t k = 0; k < 2 * columns; ++k) {
        const double low = static_cast<double>(k) / (2 * columns);
        const double high = low + 0.5 / columns;
        const double end = std::clamp(drawn.place[1], low, high);
        before += density.at({drawn.place[0], (low + end) / 2}) * (end - low);
        all += density.at({drawn.place[0], (low + high) / 2}) * (high - low);
      }
      EXPECT_NEAR(before / all, numbers[1], 1e-12);
    }
    for (const double end : {0.0, std::nextafter(1.0, 0.0)}) {
      const SquareSample drawn = density.sample({end, end});
      EXPECT_GE(drawn.place[0], 0);
      EXPECT_LE(drawn.place[0], 1);
      EXPECT_GE(drawn.place[1], 0);
      EXPECT_LE(drawn.place[1], 1);
    }
  }
}

TEST(BilinearDensity, DrawsContinuously) {
  std::vector<double> nodes = random_values(9 * 9, 8, 0.05, 1);
  nodes[40] = 50;
  const BilinearDensity density(9, 9, nodes);
  Random random(9);
  constexpr double step = 1e-9;
  for (int i = 0; i < 1000; ++i) {
    const double a = random.uniform(0, 1 - step), b = random.uniform(0, 1 - step);
    const SquareSample one = density.sample({a, b}), next = density.sample({a + step, b + step});
    // dplace/dnumber is at most mean / least, and the row's slope over its least along the columns
    EXPECT_NEAR(next.place[0], one.place[0], 100 * step);
    EXPECT_NEAR(next.place[1], one.place[1], 1e6 * step);
  }
}

// A white matt surface has albedo 1, whichever way it is stored, and its lights are drawn by the
// cosine; within what interpolation between 15 degrees and beyond the last ring (by the ratio of
// cosines) makes of a cosine.
TEST(LightNodes, OfMattWhiteFollowTheCosine) {
  std::vector<Direction> lights;
  for (int ring = 0; ring <= 5; ++ring) {
    for (int k = 0; k < std::max(6 * ring, 1); ++k) {
      lights.push_back(direction_from_degrees(15 * ring, 360.0 * k / std::max(6 * ring, 1)));
    }
  }
  for (const Quantity quantity : {Quantity::radiance, Quantity::brdf}) {
    const LightNodes nodes(lights, quantity);
    std::vector<double> luminances;
    for (const Direction& light : lights) {
      luminances.push_back(quantity == Quantity::brdf ? 1 / pi : double{light[2]} / pi);
    }
    double albedo = 0;
    for (std::size_t l = 0; l < lights.size(); ++l) {
      albedo += nodes.albedo_weights()[l] * luminances[l];
    }
    EXPECT_NEAR(albedo, 1, quantity == Quantity::brdf ? 1e-3 : 0.02);
    std::vector<double> values(nodes.count());
    nodes.gather(luminances, values);
    const BilinearDensity density = nodes.density(values);
    const BilinearDensity black = nodes.density(std::vector<double>(nodes.count()));
    Random random(3);
    for (int i = 0; i < 200; ++i) {
      const Vector3 d = hemisphere_of_square({random.uniform(), random.uniform()});
      // a cell's mean of the cosine lies within half its extent, 2 / side, of the cosine
      const double spread = 2.0 / static_cast<double>(nodes.side()) / pi;
      EXPECT_NEAR(light_density(density, d), d[2] / pi, spread);
      EXPECT_NEAR(light_density(black, d), d[2] / pi, spread);
    }
    EXPECT_EQ(light_density(density, {0.6, 0, -0.8}), 0);
  }
}

// However narrow, the one bright light is drawn for most, and the rest of the sky is not left out.
TEST(LightNodes, FindTheOneBrightLight) {
  const std::vector<Direction> lights = make_info({1, 151, 1, 1, 1}).light_directions;
  const LightNodes nodes(lights, Quantity::brdf);
  for (std::size_t bright = 0; bright < lights.size(); bright += 10) {
    std::vector<double> luminances(lights.size()), values(nodes.count());
    luminances[bright] = 1e20;
    nodes.gather(luminances, values);
    const BilinearDensity density = nodes.density(values);
    const Vector3 d{double{lights[bright][0]}, double{lights[bright][1]},
                    double{lights[bright][2]}};
    const double opposite = light_density(density, {-d[0], -d[1], d[2]});
    EXPECT_TRUE(d[2] > 0.9 || light_density(density, d) > 10 * opposite) << bright;
    std::size_t near = 0;
    for (std::size_t i = 0; i < 400; ++i) {
      const LightOfSlice drawn = draw_light(density, {(static_cast<double>(i / 20) + 0.5) / 20,
                                                      (static_cast<double>(i % 20) + 0.5) / 20});
      EXPECT_GT(drawn.density, 0);
      if (dot(drawn.direction, d) > 0.8) ++near;
    }
    EXPECT_GT(near, 200u) << bright;
    EXPECT_LT(near, 400u) << bright;
  }
}

TEST(LightNodes, TakeAnyMagnitude) {
  const std::vector<Direction> lights = make_info({1, 20, 1, 1, 1}).light_directions;
  const LightNodes nodes(lights, Quantity::radiance);
  for (const double magnitude : {0.0, 1e-320, 1e-40, 1.0, 1e38}) {
    std::vector<double> values(nodes.count());
    nodes.gather(std::vector<double>(lights.size(), magnitude), values);
    const BilinearDensity density = nodes.density(values);
    const double p = light_density(density, {0, 0, 1});
    EXPECT_GT(p, 0.1) << magnitude;
    EXPECT_LT(p, 0.5) << magnitude;
  }
}

TEST(SliceLuminance, CountsNothingNegative) {
  EXPECT_NEAR(slice_luminance(std::array{1.0, 1.0, 1.0}), 1, 1e-15);
  EXPECT_NEAR(slice_luminance(std::array{-3.0, 1.0, -1.0}), 0.7152, 1e-15);
  EXPECT_EQ(slice_luminance(std::array{0.25}), 0.25);
  EXPECT_EQ(slice_luminance(std::array{0.5, -1.0}), 0.25);
}

}  // namespace
}  // namespace weft::test
