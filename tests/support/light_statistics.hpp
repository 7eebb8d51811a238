// Whether directions to light follow the density that a sampler states.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "support/generators.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft::test {

// The direction at (z, phi): equal steps of both are equal solid angles.
inline std::array<float, 3> at_height(double z, double phi) {
  const double radius = std::sqrt(1 - z * z);
  return {static_cast<float>(radius * std::cos(phi)), static_cast<float>(radius * std::sin(phi)),
          static_cast<float>(z)};
}

// The integral of a query's density over each of rings x sectors bins of equal solid angle, by the
// midpoint rule on points x points of each.
inline std::vector<double> bin_shares(LightSampler& sampler, const LightQuery& query,
                                      std::size_t rings, std::size_t sectors, std::size_t points) {
  const std::size_t rows = rings * points, columns = sectors * points;
  std::vector<std::array<float, 3>> lights;
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t k = 0; k < columns; ++k) {
      lights.push_back(at_height(
          (static_cast<double>(i) + 0.5) / static_cast<double>(rows),
          2 * std::numbers::pi * (static_cast<double>(k) + 0.5) / static_cast<double>(columns)));
    }
  }
  const std::vector<LightQuery> queries(lights.size(), query);
  std::vector<float> densities(lights.size());
  sampler.densities(queries, lights, densities);
  std::vector<double> shares(rings * sectors);
  const double solid_angle = 2 * std::numbers::pi / static_cast<double>(rows * columns);
  for (std::size_t i = 0; i < lights.size(); ++i) {
    EXPECT_GT(densities[i], 0);
    const std::size_t bin = i / columns / points * sectors + i % columns / points;
    shares[bin] += solid_angle * double{densities[i]};
  }
  return shares;
}

// What chi^2 of that many degrees of freedom exceeds once in three million times: E. B. Wilson,
// M. M. Hilferty, The Distribution of Chi-Square (1931), at 5 standard deviations.
inline double largest_chi_square(double degrees) {
  const double variance = 2 / (9 * degrees);
  return degrees * std::pow(1 - variance + 5 * std::sqrt(variance), 3);
}

// Draws `draws` directions and checks that they fill bins as the density says, that the density
// stated with each is that of its direction, and that the whole integrates to 1.
inline void expect_follows_density(LightSampler& sampler, const LightQuery& query,
                                   std::size_t draws = 20000, std::uint64_t seed = 1) {
  constexpr std::size_t rings = 6, sectors = 12;
  const std::vector<double> shares = bin_shares(sampler, query, rings, sectors, 8);
  double whole = 0;
  for (const double share : shares) whole += share;
  EXPECT_NEAR(whole, 1, 4e-3);

  Random random(seed);
  std::vector<std::array<float, 2>> numbers;
  for (std::size_t i = 0; i < draws; ++i) {
    numbers.push_back({static_cast<float>(random.index(1 << 24)) * 0x1p-24f,
                       static_cast<float>(random.index(1 << 24)) * 0x1p-24f});
  }
  const std::vector<LightQuery> queries(draws, query);
  std::vector<DrawnLight> drawn(draws);
  sampler.sample(queries, numbers, drawn);
  std::vector<std::array<float, 3>> lights;
  std::vector<double> counts(rings * sectors);
  for (const DrawnLight& light : drawn) {
    const auto& d = light.direction;
    lights.push_back(d);
    ASSERT_NEAR(std::hypot(d[0], d[1], d[2]), 1, 1e-6);
    ASSERT_GE(d[2], 0);
    const double turn = std::atan2(double{d[1]}, double{d[0]}) / (2 * std::numbers::pi);
    const auto ring = static_cast<std::size_t>(double{d[2]} * rings);
    const auto sector = static_cast<std::size_t>((turn < 0 ? turn + 1 : turn) * sectors);
    counts[std::min(ring, rings - 1) * sectors + std::min(sector, sectors - 1)] += 1;
  }
  std::vector<float> densities(draws);
  sampler.densities(queries, lights, densities);
  for (std::size_t i = 0; i < draws; ++i) {
    ASSERT_GT(drawn[i].density, 0);
    ASSERT_NEAR(drawn[i].density, densities[i], 1e-3 * densities[i]) << i;
  }
  // bins that expect few are taken together
  double chi_square = 0, degrees = -1, pooled = 0, pooled_count = 0;
  const auto add = [&](double expected, double count) {
    chi_square += (count - expected) * (count - expected) / expected;
    degrees += 1;
  };
  for (std::size_t i = 0; i < shares.size(); ++i) {
    const double expected = shares[i] / whole * static_cast<double>(draws);
    if (expected >= 10) {
      add(expected, counts[i]);
      continue;
    }
    pooled += expected;
    pooled_count += counts[i];
  }
  if (pooled > 1) add(pooled, pooled_count);
  EXPECT_LT(chi_square, largest_chi_square(std::max(degrees, 1.0))) << degrees << " degrees";
}

}  // namespace weft::test
