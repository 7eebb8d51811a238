#include "weft/btf/radial_basis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "support/expect_error.hpp"

namespace weft {
namespace {

using Vector = RadialBasis::Vector;

// Systems of n <= 151 directions apart by some degrees have condition numbers below 1e5 (chords
// from 0.05 to 2, n of them): what is solved exactly comes back to 1e5 n eps < 1e-8.
constexpr double tolerance = 1e-8;

Vector vector_of(const Direction& d) {
  const double length = std::hypot(double{d[0]}, double{d[1]}, double{d[2]});
  return {d[0] / length, d[1] / length, d[2] / length};
}

Vector random_direction(std::mt19937& random, double most_theta) {
  std::uniform_real_distribution<double> unit(0, 1);
  const double z = 1 - unit(random) * (1 - std::cos(most_theta * std::numbers::pi / 180));
  const double phi = 2 * std::numbers::pi * unit(random), s = std::sqrt(1 - z * z);
  return {s * std::cos(phi), s * std::sin(phi), z};
}

double value_at(const RadialBasis& basis, const std::vector<Direction>& measured,
                const std::function<double(const Vector&)>& f, const Vector& d) {
  std::vector<double> weights(basis.size());
  basis.weigh(d, weights);
  double value = 0;
  for (std::size_t i = 0; i < measured.size(); ++i) value += weights[i] * f(vector_of(measured[i]));
  return value;
}

TEST(RadialBasis, MeasuredDirectionsKeepTheirValuesToTheBit) {
  for (const std::vector<Direction>& set :
       {ubo81_directions(), ubo151_directions(), even_directions(1), even_directions(2),
        even_directions(3), even_directions(40)}) {
    const RadialBasis basis(set, "light");
    std::vector<double> weights(set.size());
    for (std::size_t i = 0; i < set.size(); ++i) {
      EXPECT_EQ(basis.weigh(vector_of(set[i]), weights), 1);
      for (std::size_t k = 0; k < set.size(); ++k) EXPECT_EQ(weights[k], i == k ? 1 : 0);
    }
  }
}

TEST(RadialBasis, LinearFunctionsAreReproduced) {
  const std::vector<Direction> set = ubo81_directions();
  const RadialBasis basis(set, "light");
  const auto linear = [](const Vector& d) { return 2 - 3 * d[0] + 0.5 * d[1] + d[2]; };
  std::mt19937 random(3);
  for (int i = 0; i < 300; ++i) {
    const Vector d = random_direction(random, 74);
    EXPECT_NEAR(value_at(basis, set, linear, d), linear(d), tolerance);
  }
}

TEST(RadialBasis, SmoothFunctionsAreApproached) {
  // Closer rings, smaller errors; and with it a spline of least bending is better than triangles.
  const auto lobe = [](const Vector& d) {
    return std::exp(4 * (0.5 * d[0] + 0.3 * d[1] + 0.81 * d[2] - 1));
  };
  std::mt19937 random(4);
  double coarse = 0, fine = 0, flat = 0;
  const std::vector<Direction> few = even_directions(40), many = even_directions(300);
  const RadialBasis of_few(few, "light"), of_many(many, "light");
  const Hemisphere triangles(many);
  for (int i = 0; i < 300; ++i) {
    const Vector d = random_direction(random, 65);
    coarse += std::pow(value_at(of_few, few, lobe, d) - lobe(d), 2);
    fine += std::pow(value_at(of_many, many, lobe, d) - lobe(d), 2);
    const DirectionWeights w = triangles.at(d);
    double between = 0;
    for (std::size_t k = 0; k < 3; ++k) between += w.weight[k] * lobe(vector_of(many[w.index[k]]));
    flat += std::pow(between - lobe(d), 2);
  }
  EXPECT_LT(fine, coarse / 10);
  EXPECT_LT(fine, flat);
  EXPECT_LT(std::sqrt(coarse / 300), 0.05);
}

TEST(RadialBasis, WeightsAreContinuousAndSumToOne) {
  const std::vector<Direction> set = ubo81_directions();
  const RadialBasis basis(set, "light");
  std::vector<double> before, weights(set.size());
  // From the zenith over the hull's edge to the horizon: |weight| moves by at most some times the
  // step, over the distance between directions, 0.25.
  constexpr double step = 1e-3;
  for (double theta = 1e-4; theta < std::numbers::pi / 2; theta += step) {
    basis.weigh({std::sin(theta) * 0.6, std::sin(theta) * 0.8, std::cos(theta)}, weights);
    double sum = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      sum += weights[i];
      if (!before.empty()) {
        EXPECT_LT(std::abs(weights[i] - before[i]), 20 * step) << theta;
      }
    }
    EXPECT_NEAR(sum, 1, tolerance);
    before = weights;
  }
}

TEST(RadialBasis, OutsideTheHullIsClamped) {
  const std::vector<Direction> set = ubo81_directions();
  const RadialBasis basis(set, "light");
  std::vector<double> edge(set.size()), outside(set.size());
  // Beyond a measured direction of the last ring: its value, scaled by the cosines.
  const double factor = basis.weigh({1, 0, 0}, outside);
  EXPECT_EQ(factor, 0);
  EXPECT_EQ(basis.weigh(vector_of(direction_from_degrees(75, 0)), edge), 1);
  EXPECT_EQ(outside, edge);
  const double at80 = basis.weigh(vector_of(direction_from_degrees(80, 0)), outside);
  EXPECT_EQ(outside, edge);
  EXPECT_NEAR(at80, std::cos(80 * std::numbers::pi / 180) / std::cos(75 * std::numbers::pi / 180),
              1e-6);
}

TEST(RadialBasis, FewFlatAndDuplicateDirections) {
  std::vector<double> weights(1);
  EXPECT_GT(RadialBasis(std::vector<Direction>{{0, 0, 1}}, "view").weigh({0.6, 0, 0.8}, weights),
            0);
  EXPECT_EQ(weights[0], 1);
  // Two close to each other: what lies far away does not run away.
  const std::vector<Direction> two{direction_from_degrees(0, 0), direction_from_degrees(1, 0)};
  weights.resize(2);
  RadialBasis(two, "view").weigh({std::sin(1.2), 0, std::cos(1.2)}, weights);
  EXPECT_NEAR(weights[0], 0, tolerance);
  EXPECT_NEAR(weights[1], 1, tolerance);
  // A ring lies in a plane, a meridian on a great circle.
  std::vector<Direction> ring, meridian;
  for (int i = 0; i < 12; ++i) {
    ring.push_back(direction_from_degrees(45, 30 * i));
    meridian.push_back(direction_from_degrees(7 * i, 90));
  }
  for (const auto& set : {ring, meridian}) {
    const RadialBasis basis(set, "light");
    weights.resize(set.size());
    basis.weigh(vector_of(direction_from_degrees(40, 85)), weights);
    double sum = 0, largest = 0;
    for (const double w : weights) {
      sum += w;
      largest = std::max(largest, std::abs(w));
    }
    EXPECT_NEAR(sum, 1, tolerance);
    EXPECT_LT(largest, 2);
  }
  // Directions measured twice count half.
  std::vector<Direction> twice = ubo81_directions();
  twice.insert(twice.end(), twice.begin(), twice.end());
  const RadialBasis once(ubo81_directions(), "light"), doubled(twice, "light");
  std::vector<double> single(81), both(162);
  const Vector d = vector_of(direction_from_degrees(33, 77));
  once.weigh(d, single);
  doubled.weigh(d, both);
  for (std::size_t i = 0; i < 81; ++i) {
    EXPECT_NEAR(both[i], single[i] / 2, tolerance);
    EXPECT_EQ(both[i], both[i + 81]);
  }
}

TEST(RadialBasis, WhatIsNoDirectionOfTheHemisphereIsRefused) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const Direction bad :
       {Direction{0, 0.6f, -0.8f}, Direction{0, 0, 0}, Direction{nan, 0, 1}}) {
    const std::vector<Direction> set{{0, 0, 1}, bad};
    test::expect_error(ErrorKind::input, {"light direction 1"},
                       [&] { const RadialBasis basis(set, "light"); });
  }
  const std::vector<Direction> below{{0, 0.6f, -0.8f}};
  test::expect_error(ErrorKind::input, {"view direction 0", "below the horizon", "-0.8"},
                     [&] { const RadialBasis basis(below, "view"); });
  test::expect_error(ErrorKind::input, {"0 view directions"},
                     [] { const RadialBasis basis({}, "view"); });
  const std::vector<Direction> many(RadialBasis::most_directions + 1, Direction{0, 0, 1});
  test::expect_error(ErrorKind::input, {"4097", "4096"},
                     [&] { const RadialBasis basis(many, "light"); });
  // What rounding puts below the horizon is at it.
  const std::vector<Direction> rounded{{1, 0, -4e-8f}, {0, 0, 1}};
  EXPECT_EQ(RadialBasis(rounded, "light").size(), 2u);
}

}  // namespace
}  // namespace weft
