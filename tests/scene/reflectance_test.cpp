#include "weft/scene/reflectance.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/generators.hpp"

namespace weft::test {
namespace {

constexpr double pi = std::numbers::pi;

Vector3 random_direction(Random& random, double least_z = 0.05) {
  const double z = random.uniform(least_z, 1), phi = random.uniform(0, 2 * pi);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

TEST(Reflectance, LambertianPlane) {
  const Vector3 light = normalized({0.3, -0.4, 0.5});
  const Vector3 value = reflected({}, {0.2f, 0.5f, 1.0f}, GlossyLobe{}, {0, 0, 1}, light);
  EXPECT_NEAR(value[0], 0.2f / pi * light[2], 1e-15);
  EXPECT_NEAR(value[1], 0.5 / pi * light[2], 1e-15);
  EXPECT_NEAR(value[2], 1 / pi * light[2], 1e-15);
}

TEST(Reflectance, NothingFromBehind) {
  const GlossyLobe lobe{{0.5f, 0.5f, 0.5f}, 1, 0.3f, 0.3f};
  const ShadingFrame frame = make_frame(normalized({1, 0, 0.1}), {0, 1, 0});
  const Vector3 behind = normalized({-1, 0, 0.05});
  EXPECT_EQ(reflected(frame, {1, 1, 1}, lobe, {0, 0, 1}, behind), Vector3{});
  // A view behind an interpolated normal still sees the diffuse part, and no gloss.
  const Vector3 seen = reflected(frame, {1, 1, 1}, lobe, behind, {0, 0, 1});
  EXPECT_NEAR(seen[0], dot(frame.normal, {0, 0, 1}) / pi, 1e-15);
}

TEST(Reflectance, FrameIsOrthonormal) {
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const Vector3 n = random_direction(random);
    const double phi = random.uniform(0, 2 * pi);
    const ShadingFrame frame = make_frame(n, {std::cos(phi), std::sin(phi), 0});
    EXPECT_NEAR(dot(frame.along, frame.along), 1, 1e-14);
    EXPECT_NEAR(dot(frame.across, frame.across), 1, 1e-14);
    EXPECT_NEAR(dot(frame.along, frame.normal), 0, 1e-14);
    EXPECT_NEAR(dot(frame.across, frame.along), 0, 1e-14);
  }
  // No direction is left where the fibre is the normal, but no NaN either.
  const ShadingFrame degenerate = make_frame({1, 0, 0}, {1, 0, 0});
  EXPECT_EQ(degenerate.along, (Vector3{0, 0, 0}));
}

TEST(Reflectance, IsReciprocal) {
  Random random(7);
  for (int i = 0; i < 1000; ++i) {
    const GlossyLobe lobe{{0.1f, 0.3f, 0.9f},
                          1,
                          static_cast<float>(random.uniform(0.05, 1)),
                          static_cast<float>(random.uniform(0.05, 1))};
    const double phi = random.uniform(0, 2 * pi);
    const ShadingFrame frame =
        make_frame(random_direction(random, 0.8), {std::cos(phi), std::sin(phi), 0});
    const Vector3 v = random_direction(random), l = random_direction(random);
    const double nv = dot(frame.normal, v), nl = dot(frame.normal, l);
    if (nv <= 0.01 || nl <= 0.01) continue;
    const Vector3 there = reflected(frame, {0.5f, 0.2f, 0}, lobe, v, l);
    const Vector3 back = reflected(frame, {0.5f, 0.2f, 0}, lobe, l, v);
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(there[c] / nl, back[c] / nv, 1e-12 * (1 + there[c] / nl));
    }
  }
}

// The microfacets' normals, projected on the plane, make up its area: the integral of D(h) h.n
// is 1.
TEST(Reflectance, DistributionIsNormalised) {
  for (const auto& [a, b] : {std::pair{0.6f, 0.6f}, {0.3f, 0.8f}, {0.9f, 0.2f}}) {
    // f(v, v) of a white lobe with v = h: F = f0 = 1, D V with V = 1 / (4 n.v |(a v.t, b v.b,
    // n.v)|).
    const GlossyLobe lobe{{1, 1, 1}, 1, a, b};
    double sum = 0;
    constexpr int thetas = 2000, phis = 400;
    for (int i = 0; i < thetas; ++i) {
      const double theta = (i + 0.5) / thetas * pi / 2;
      for (int k = 0; k < phis; ++k) {
        const double phi = (k + 0.5) / phis * 2 * pi;
        const Vector3 h{std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                        std::cos(theta)};
        const double value = reflected({}, {0, 0, 0}, lobe, h, h)[0];  // D V n.h
        const double length = std::sqrt(a * h[0] * a * h[0] + b * h[1] * b * h[1] + h[2] * h[2]);
        const double distribution = value * 4 * length;
        sum += distribution * h[2] * std::sin(theta);
      }
    }
    sum *= (pi / 2 / thetas) * (2 * pi / phis);
    EXPECT_NEAR(sum, 1, 1e-3) << a << " " << b;  // the midpoint rule's error at these steps
  }
}

// No lobe returns more light than it receives.
TEST(Reflectance, WhiteFurnace) {
  for (const auto& [a, b] : {std::pair{0.3f, 0.3f}, {0.2f, 0.7f}, {1.0f, 1.0f}}) {
    const GlossyLobe lobe{{1, 1, 1}, 1, a, b};
    for (const double theta : {0.0, 40.0, 75.0}) {
      const Vector3 view{std::sin(theta * pi / 180), 0, std::cos(theta * pi / 180)};
      double sum = 0;
      constexpr int zs = 400, phis = 400;
      for (int i = 0; i < zs; ++i) {
        const double z = (i + 0.5) / zs, r = std::sqrt(1 - z * z);
        for (int k = 0; k < phis; ++k) {
          const double phi = (k + 0.5) / phis * 2 * pi;
          sum += reflected({}, {0, 0, 0}, lobe, view, {r * std::cos(phi), r * std::sin(phi), z})[0];
        }
      }
      sum *= 2 * pi / zs / phis;
      EXPECT_LT(sum, 1.001) << a << " " << b << " " << theta;
      EXPECT_GT(sum, 0.3) << a << " " << b << " " << theta;
    }
  }
}

}  // namespace
}  // namespace weft::test
