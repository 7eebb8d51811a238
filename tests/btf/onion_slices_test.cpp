#include "weft/btf/onion_slices.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "support/expect_error.hpp"

namespace weft {
namespace {

using Vector = OnionSlices::Vector;

constexpr double degree = std::numbers::pi / 180;
// A handful of roundings of numbers up to 360, divided by the smallest sine or step that is tested.
constexpr double tolerance = 1e-11;

Vector direction(double theta, double phi) {
  return {std::sin(theta * degree) * std::cos(phi * degree),
          std::sin(theta * degree) * std::sin(phi * degree), std::cos(theta * degree)};
}

void expect_near(const Vector& a, const Vector& b, double within) {
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], within) << i;
}

TEST(OnionSlices, NodesOfThePaper) {
  const OnionSlices grid(OnionSizes{});
  EXPECT_EQ(grid.sizes().views() * grid.sizes().lights(), 13552u);  // section 6
  EXPECT_EQ(grid.phi(1), 22.5);
  EXPECT_EQ(grid.theta(0), 0);
  EXPECT_EQ(grid.theta(6), 90);
  EXPECT_EQ(grid.theta(1), 15);
  EXPECT_EQ(grid.alpha(0), -90);
  EXPECT_EQ(grid.alpha(5), 0);
  EXPECT_NEAR(grid.alpha(6), 18, tolerance);
  EXPECT_EQ(grid.sine_beta(5), 0);
  // equidistant along the chord, figure 5b
  for (std::size_t b = 0; b + 1 < 11; ++b) {
    EXPECT_NEAR(grid.sine_beta(b + 1) - grid.sine_beta(b), 0.2, tolerance);
  }
  EXPECT_TRUE(grid.at_pole(0));
  EXPECT_TRUE(grid.at_pole(10));
  EXPECT_FALSE(grid.at_pole(1));
  EXPECT_EQ(grid.views().size(), 112u);
  EXPECT_EQ(grid.turned_lights().size(), 121u);
}

TEST(OnionSlices, MirroredViewsAreInTheMiddleOfASlice) {
  const OnionSlices grid(OnionSizes{});
  for (const double theta : {0.0, 18.0, 36.0, 54.0, 72.0}) {
    for (const double phi : {0.0, 33.0, 180.0, 299.0}) {
      const OnionPosition at = grid.at(direction(theta, phi), direction(theta, phi + 180));
      EXPECT_NEAR(at.beta, 5, tolerance) << theta << " " << phi;
      EXPECT_NEAR(at.alpha, 5 - theta / 18, tolerance) << theta << " " << phi;
      EXPECT_NEAR(at.theta, theta / 15, tolerance);
      // and the view itself is on the other side
      EXPECT_NEAR(grid.at(direction(theta, phi), direction(theta, phi)).alpha, 5 + theta / 18,
                  tolerance);
    }
  }
}

TEST(OnionSlices, NodesComeBack) {
  for (const OnionSizes sizes : {OnionSizes{}, OnionSizes{1, 2, 2, 3}, OnionSizes{5, 4, 3, 2}}) {
    const OnionSlices grid(sizes);
    for (std::size_t k = 0; k < sizes.phi; ++k) {
      for (std::size_t j = 0; j < sizes.theta; ++j) {
        for (std::size_t a = 0; a < sizes.alpha; ++a) {
          for (std::size_t b = 0; b < sizes.beta; ++b) {
            const auto K = static_cast<double>(k), J = static_cast<double>(j);
            const auto A = static_cast<double>(a), B = static_cast<double>(b);
            const Vector view = grid.view(K, J);
            // the zenith has no azimuth: it is taken for that of turn 0
            const Vector light = grid.light(j == 0 ? 0 : K, A, B);
            EXPECT_NEAR(std::hypot(light[0], light[1], light[2]), 1, tolerance);
            EXPECT_GE(light[2], 0);
            const OnionPosition at = grid.at(view, light);
            if (j > 0) {
              EXPECT_NEAR(std::remainder(at.phi - K, sizes.phi), 0, tolerance);
            }
            EXPECT_NEAR(at.theta, J, tolerance);
            // near a pole alpha is the quotient of two small numbers
            if (!grid.at_pole(b)) {
              EXPECT_NEAR(at.alpha, A, tolerance);
            }
            EXPECT_NEAR(at.beta, B, tolerance);
          }
        }
      }
    }
  }
}

TEST(OnionSlices, AnyPairComesBack) {
  const OnionSlices grid(OnionSizes{13, 6, 9, 8});
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < 2000; ++i) {
    const Vector view = direction(90 * unit(random), 360 * unit(random));
    const Vector light = direction(90 * unit(random), 360 * unit(random));
    const OnionPosition at = grid.at(view, light);
    EXPECT_GE(at.phi, 0);
    EXPECT_LT(at.phi, 13);
    expect_near(grid.view(at.phi, at.theta), view, tolerance);
    // sqrt(1 - sin^2 beta) loses half the digits next to the poles
    expect_near(grid.light(at.phi, at.alpha, at.beta), light, 1e-7);
  }
}

TEST(OnionSlices, EqualCellsHaveEqualSolidAngles) {
  // Uniform in alpha and sin beta, directions are uniform over the hemisphere: mean of z is 1 / 2,
  // of z^2, x^2 and y^2 1 / 3. Midpoint rule over 400 x 400 cells: errors far below 1e-4.
  const OnionSlices grid(OnionSizes{1, 1, 2, 2});
  constexpr int n = 400;
  double z = 0, xx = 0, yy = 0;
  for (int a = 0; a < n; ++a) {
    for (int b = 0; b < n; ++b) {
      const Vector d = grid.turned_light((a + 0.5) / n, (b + 0.5) / n);
      z += d[2];
      xx += d[0] * d[0];
      yy += d[1] * d[1];
    }
  }
  EXPECT_NEAR(z / (n * n), 0.5, 1e-4);
  EXPECT_NEAR(xx / (n * n), 1.0 / 3, 1e-4);
  EXPECT_NEAR(yy / (n * n), 1.0 / 3, 1e-4);
}

TEST(OnionSlices, SeamsOfDirections) {
  const OnionSlices grid(OnionSizes{});
  // All slices meet in the poles.
  for (std::size_t a = 0; a < 11; ++a) {
    expect_near(grid.turned_light(static_cast<double>(a), 0), {0, -1, 0}, tolerance);
    expect_near(grid.turned_light(static_cast<double>(a), 10), {0, 1, 0}, tolerance);
  }
  // The pole has some position; so has what is below the horizon, at its azimuth.
  const OnionPosition pole = grid.at({1, 0, 0}, {0, 1, 0});
  EXPECT_EQ(pole.alpha, 5);
  EXPECT_EQ(pole.beta, 10);
  const OnionPosition below = grid.at({1, 0, -0.5}, {-3, 0, -4});
  EXPECT_EQ(below.theta, 6);
  EXPECT_EQ(below.alpha, 0);
  EXPECT_EQ(below.beta, 5);
  const OnionPosition down = grid.at({0, 0, -1}, {0, 0, -1});
  EXPECT_TRUE(std::isfinite(down.phi + down.theta + down.alpha + down.beta));
  // Horizon nodes are on it exactly.
  EXPECT_EQ(grid.view(3, 6)[2], 0);
  EXPECT_EQ(grid.turned_light(0, 4)[2], 0);
  EXPECT_EQ(grid.turned_light(10, 4)[2], 0);
  // Any turn of the zenith view is the zenith.
  for (std::size_t k = 0; k < 16; ++k) {
    expect_near(grid.view(static_cast<double>(k), 0), {0, 0, 1}, 0);
  }
  // An azimuth just below 0 is one just below a whole turn.
  const OnionPosition before = grid.at(direction(30, -1e-3), {0, 0, 1});
  EXPECT_NEAR(before.phi, 16 - 1e-3 / 22.5, tolerance);
  EXPECT_LT(grid.at({1, -1e-300, 0}, {0, 0, 1}).phi, 16);
}

TEST(OnionSlices, StepsGoRoundOrEnd) {
  const OnionSlices grid(OnionSizes{4, 3, 2, 1});
  const auto expect_step = [](const OnionStep& step, std::size_t low, std::size_t high, double f) {
    EXPECT_EQ(step.low, low);
    EXPECT_EQ(step.high, high);
    EXPECT_NEAR(step.fraction, f, tolerance);
  };
  expect_step(grid.phi_step(0), 0, 1, 0);
  expect_step(grid.phi_step(3.75), 3, 0, 0.75);
  expect_step(grid.phi_step(4), 0, 1, 0);
  expect_step(grid.phi_step(-0.25), 3, 0, 0.75);
  expect_step(grid.theta_step(0), 0, 1, 0);
  expect_step(grid.theta_step(1.5), 1, 2, 0.5);
  expect_step(grid.theta_step(2), 1, 2, 1);
  expect_step(grid.theta_step(99), 1, 2, 1);
  expect_step(grid.alpha_step(0.25), 0, 1, 0.25);
  expect_step(grid.beta_step(0), 0, 0, 0);
}

TEST(OnionSlices, SizesOfOneDependOnNothing) {
  const OnionSlices grid(OnionSizes{1, 1, 1, 1});
  expect_near(grid.view(0, 0), {0, 0, 1}, 0);
  expect_near(grid.turned_light(0, 0), {0, 0, 1}, 0);
  const OnionPosition at = grid.at(direction(50, 70), direction(20, 200));
  EXPECT_EQ(at.phi + at.theta + at.alpha + at.beta, 0);
  // Isotropic: lights are turned with the view all the same.
  const OnionSlices isotropic(OnionSizes{1, 7, 11, 11});
  const OnionPosition one = isotropic.at(direction(30, 10), direction(60, 110));
  const OnionPosition other = isotropic.at(direction(30, 200), direction(60, 300));
  EXPECT_EQ(one.phi, 0);
  EXPECT_EQ(other.phi, 0);
  EXPECT_NEAR(one.alpha, other.alpha, tolerance);
  EXPECT_NEAR(one.beta, other.beta, tolerance);
}

TEST(OnionSlices, SizesFromText) {
  EXPECT_EQ(parse_onion_sizes("11,9,7,16", "--onion"), (OnionSizes{16, 7, 11, 9}));
  for (const std::string bad :
       {"", "11", "11,11,7", "11,11,7,16,1", "11,11,7,", "0,11,7,16", "11,11,7,-1", "a,b,c,d",
        "11, 11,7,16", "99999999,99999999,7,16", "99999999999999999999999,1,1,1"}) {
    test::expect_error(ErrorKind::input, {"--onion"}, [&] { parse_onion_sizes(bad, "--onion"); });
  }
  test::expect_error(ErrorKind::input, {"n_theta 0"}, [] {
    const OnionSlices grid(OnionSizes{16, 0, 11, 11});
  });
}

}  // namespace
}  // namespace weft
