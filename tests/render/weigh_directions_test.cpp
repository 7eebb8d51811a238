// The walk over measured directions on the device, against Hemisphere::at.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <numbers>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/ops/shade.hpp"

namespace weft::test {
namespace {

// Unit vectors all over the sphere, the measured directions, and what lies between and about them.
std::vector<std::array<float, 4>> directions_to_try(std::span<const Direction> measured,
                                                    std::size_t count) {
  Random random(5);
  std::vector<std::array<float, 4>> list{{0, 0, 1, 0}, {1, 0, 0, 0}, {0, -1, 0, 0}, {0, 0, -1, 0}};
  for (const Direction& d : measured) list.push_back({d[0], d[1], d[2], 0});
  while (list.size() < measured.size() + count) {
    const double z = random.uniform(-0.2, 1.0), phi = random.uniform(0, 2 * std::numbers::pi);
    const double r = std::sqrt(1 - z * z);
    list.push_back({static_cast<float>(r * std::cos(phi)), static_cast<float>(r * std::sin(phi)),
                    static_cast<float>(z), 0});
  }
  return list;
}

void expect_weights(const std::vector<Direction>& measured, std::size_t count = 3000) {
  Device& device = shared_device();
  const Hemisphere hemisphere(measured);
  const ops::DeviceHemisphere tables(device, hemisphere);
  const auto directions = directions_to_try(measured, count);
  GuardedBuffer in(device, std::span<const std::array<float, 4>>(directions), "directions");
  GuardedBuffer out(device, directions.size() * 32, "weights");
  tables.weigh(device, directions.size(), in.buffer(), out.buffer());
  const std::vector<std::uint32_t> words = out.values<std::uint32_t>();
  EXPECT_TRUE(out.intact());

  // A weight is the product of a row with a unit vector, each rounded: 8 roundings of the row's
  // size. On top, weights down to -1e-6 are taken for 0.
  const HemisphereTables host = hemisphere.tables();
  double largest_row = 1;
  for (const auto* rows : {&host.triangle_rows, &host.edge_rows}) {
    for (const float x : *rows) largest_row = std::max(largest_row, std::abs(double{x}));
  }
  const double tolerance = 3 * largest_row * gamma(8, float_roundoff) + 4e-6;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const auto& d = directions[i];
    const DirectionWeights expected = hemisphere.at({d[0], d[1], d[2]});
    std::vector<double> dense(measured.size(), 0.0), found(measured.size(), 0.0);
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      dense[expected.index[k]] += expected.weight[k];
      ASSERT_LT(words[8 * i + k], measured.size());
      const auto weight = static_cast<double>(std::bit_cast<float>(words[8 * i + 3 + k]));
      ASSERT_GE(weight, 0);
      found[words[8 * i + k]] += weight;
      sum += weight;
    }
    ASSERT_NEAR(sum, 1, 4 * float_roundoff);
    ASSERT_TRUE(all_near(found, dense, tolerance))
        << "direction " << d[0] << " " << d[1] << " " << d[2];
    const auto scale = static_cast<double>(std::bit_cast<float>(words[8 * i + 6]));
    // Of one cosine by another, each as exact as the weights; none is below an eighth of its scale
    // where it counts.
    ASSERT_NEAR(scale, expected.scale, 32 * tolerance) << d[0] << " " << d[1] << " " << d[2];
    ASSERT_EQ(std::bit_cast<float>(words[8 * i + 7]), d[2]);
  }
}

TEST(WeighDirections, SmallSet) {
  expect_weights(even_directions(7), 30);
}

TEST(WeighDirections, UsualSets) {
  expect_weights(ubo81_directions());
  expect_weights(ubo151_directions());
  expect_weights(even_directions(50));
}

TEST(WeighDirections, SetsWithoutArea) {
  expect_weights({direction_from_degrees(30, 40)});
  expect_weights({direction_from_degrees(10, 0), direction_from_degrees(60, 0)});
  std::vector<Direction> arc;
  for (const double theta : {70.0, 35.0, 0.0}) arc.push_back(direction_from_degrees(theta, 90));
  expect_weights(arc);
  std::vector<Direction> ring;
  for (int i = 0; i < 8; ++i) ring.push_back(direction_from_degrees(60, 45 * i));
  expect_weights(ring);
  expect_weights({direction_from_degrees(20, 0), direction_from_degrees(20, 0),
                  direction_from_degrees(50, 100), direction_from_degrees(70, 200)});
}

}  // namespace
}  // namespace weft::test
