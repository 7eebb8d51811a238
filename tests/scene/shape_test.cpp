#include "weft/scene/shape.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/scene/tangent_frame.hpp"
#include "weft/scene/vector.hpp"

namespace weft::test {
namespace {

using std::numbers::pi;

Vector3 random_unit(Random& random) {
  const double z = random.uniform(-1, 1), phi = random.uniform(0, 2 * pi);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

void expect_near(const Vector3& a, const Vector3& b, double tolerance) {
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], tolerance);
}

void expect_orthonormal(const TangentFrame& frame) {
  EXPECT_NEAR(length(frame.tangent), 1, 1e-12);
  EXPECT_NEAR(length(frame.bitangent), 1, 1e-12);
  EXPECT_NEAR(length(frame.normal), 1, 1e-12);
  EXPECT_NEAR(dot(frame.tangent, frame.normal), 0, 1e-9);
  EXPECT_NEAR(dot(frame.bitangent, frame.normal), 0, 1e-9);
  EXPECT_NEAR(dot(frame.tangent, frame.bitangent), 0, 1e-9);
}

TEST(Plane, IsMetWhereItIs) {
  const auto plane = make_plane({4, 8});
  const auto hit = plane->intersect({{0.5, -0.25, 2}, {0, 0, -1}});
  ASSERT_TRUE(hit.has_value());
  EXPECT_EQ(hit->distance, 2);
  expect_near(hit->position, {0.5, -0.25, 0}, 0);
  expect_near(hit->normal, {0, 0, 1}, 0);
  EXPECT_EQ(hit->uv, (std::array<double, 2>{3, 3}));
  EXPECT_FALSE(plane->intersect({{1.01, 0, 2}, {0, 0, -1}}));
  EXPECT_FALSE(plane->intersect({{0, 0, 2}, {0, 0, 1}}));
  EXPECT_FALSE(plane->intersect({{0, 0, 2}, {1, 0, 0}}));
  const auto below = plane->intersect({{0, 0, -2}, {0, 0, 1}});
  ASSERT_TRUE(below.has_value());
  expect_near(below->normal, {0, 0, -1}, 0);
  EXPECT_TRUE(plane->occludes(below->position, below->normal, {0, 0, 1}));
  EXPECT_FALSE(plane->occludes(below->position, below->normal, {0, 0, -1}));
}

TEST(Sphere, IsMetOnItsSurface) {
  const auto sphere = make_sphere({3, 3});
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 eye = scaled(random_unit(random), 3);
    const Vector3 target = scaled(random_unit(random), 0.99);
    const Ray ray{eye, normalized(difference(target, eye))};
    const auto hit = sphere->intersect(ray);
    ASSERT_TRUE(hit.has_value());
    EXPECT_NEAR(length(hit->position), 1, 1e-14);
    expect_near(hit->position, sum(ray.origin, scaled(ray.direction, hit->distance)), 1e-14);
    EXPECT_LT(dot(hit->normal, ray.direction), 0);
    EXPECT_GE(hit->uv[0], 0);
    EXPECT_LE(hit->uv[0], 6);
    EXPECT_GE(hit->uv[1], 0);
    EXPECT_LE(hit->uv[1], 3);
  }
  EXPECT_FALSE(sphere->intersect({{0, -3, 1.001}, {0, 1, 0}}));
  EXPECT_FALSE(sphere->intersect({{0, -3, 0}, {0, -1, 0}}));
  const auto inside = sphere->intersect({{0, 0, 0}, {0, 1, 0}});
  ASSERT_TRUE(inside.has_value());
  expect_near(inside->normal, {0, -1, 0}, 1e-15);
}

// The derivatives are those of the texture coordinates: a small step along dp/du changes u alone.
TEST(Sphere, DerivativesFollowTheTexture) {
  const auto sphere = make_sphere({2.5, 3});
  Random random(2);
  const auto at = [&](const Vector3& p) {
    const Vector3 out = normalized(p);
    return *sphere->intersect({scaled(out, 2), scaled(out, -1)});
  };
  for (int i = 0; i < 500; ++i) {
    const SurfaceHit hit = at(random_unit(random));
    // Away from the pole, where derivatives are large, and from the seam.
    if (std::abs(hit.position[2]) > 0.98 || hit.uv[0] < 0.1 || hit.uv[0] > 4.9) continue;
    constexpr double step = 1e-5;
    const SurfaceHit u = at(sum(hit.position, scaled(hit.along_u, step)));
    const SurfaceHit v = at(sum(hit.position, scaled(hit.along_v, step)));
    // The second derivatives of latitude and longitude times the square of the step.
    EXPECT_NEAR((u.uv[0] - hit.uv[0]) / step, 1, 1e-3);
    EXPECT_NEAR((u.uv[1] - hit.uv[1]) / step, 0, 1e-3);
    EXPECT_NEAR((v.uv[0] - hit.uv[0]) / step, 0, 1e-3);
    EXPECT_NEAR((v.uv[1] - hit.uv[1]) / step, 1, 1e-3);
    const TangentFrame frame = tangent_frame(hit, hit.normal);
    expect_near(cross(frame.tangent, frame.bitangent), frame.normal, 1e-12);
  }
}

// A whole number of tiles goes round, so that the texture closes at the back.
TEST(Sphere, SeamCloses) {
  for (const double repeat : {0.2, 1.0, 2.3, 2.5, 7.0}) {
    const auto sphere = make_sphere({repeat, repeat});
    const auto left = sphere->intersect({{-1e-9, 3, 0}, {0, -1, 0}});
    const auto right = sphere->intersect({{1e-9, 3, 0}, {0, -1, 0}});
    const double round = right->uv[0] - left->uv[0];
    EXPECT_NEAR(round, std::max(1.0, std::round(2 * repeat)), 1e-7);
    expect_near(tangent_frame(*left, {0, 1, 0}).tangent, tangent_frame(*right, {0, 1, 0}).tangent,
                1e-7);
  }
}

TEST(Sphere, FramesArePerpendicularEvenAtThePoles) {
  const auto sphere = make_sphere({2, 2});
  for (const Vector3& p : {Vector3{0, 0, 1}, {0, 0, -1}, {1e-9, 0, 1}, {-1e-12, 1e-12, -1}}) {
    const auto hit = sphere->intersect({scaled(p, 3), normalized(scaled(p, -1))});
    ASSERT_TRUE(hit.has_value());
    const TangentFrame frame = tangent_frame(*hit, normalized(p));
    expect_orthonormal(frame);
    expect_near(cross(frame.tangent, frame.bitangent), frame.normal, 1e-12);
  }
  const auto pole = sphere->intersect({{0, 0, 3}, {0, 0, -1}});
  expect_near(tangent_frame(*pole, {0, 0, 1}).tangent, {1, 0, 0}, 1e-12);
}

TEST(TangentFrame, HandlesDegenerateTexture) {
  Random random(3);
  for (int i = 0; i < 300; ++i) {
    SurfaceHit hit;
    hit.normal = hit.geometric_normal = random_unit(random);
    const Vector3 u = random_unit(random), v = random_unit(random);
    hit.along_u = i % 3 == 1 ? Vector3{} : u;
    hit.along_v = i % 3 == 2 ? Vector3{} : v;
    if (i % 7 == 0) hit.along_u = hit.along_v = {};
    if (i % 11 == 0) hit.along_u = hit.normal;
    const TangentFrame frame = tangent_frame(hit, hit.normal);
    expect_orthonormal(frame);
    if (i % 3 == 0 && i % 7 != 0 && i % 11 != 0) {
      EXPECT_GT(dot(frame.tangent, u), 0);
      EXPECT_GT(dot(frame.bitangent, difference(v, scaled(frame.tangent, dot(v, frame.tangent)))),
                0);
    }
  }
}

TEST(TangentFrame, MirrorsWithTheTexture) {
  SurfaceHit hit;
  hit.along_u = {-1, 0, 0};
  const TangentFrame frame = tangent_frame(hit, {0, 0, 1});
  expect_near(frame.tangent, {-1, 0, 0}, 0);
  expect_near(frame.bitangent, {0, 1, 0}, 0);
}

// The bent normal is seen from above the horizon, and joins the others without a step.
TEST(TangentFrame, BendsNormalsThatTurnAway) {
  SurfaceHit hit;
  Vector3 before{};
  for (int i = 0; i <= 400; ++i) {
    const double angle = (80 + 0.1 * i) * pi / 180;  // of the normal to the eye
    hit.normal = {std::sin(angle), 0, std::cos(angle)};
    const TangentFrame frame = tangent_frame(hit, {0, 0, 1});
    expect_orthonormal(frame);
    EXPECT_GT(dot(frame.normal, {0, 0, 1}), 0.0199);
    if (i > 0) {
      EXPECT_LT(length(difference(frame.normal, before)), 0.002);
    }
    before = frame.normal;
  }
}

TEST(Repeat, IsWithinBounds) {
  expect_error(ErrorKind::input, {"repeat", "0 x 1"}, [] { make_plane({0, 1}); });
  expect_error(ErrorKind::input, {"repeat", "nan"}, [] { make_sphere({1, NAN}); });
  expect_error(ErrorKind::input, {"repeat", "-2"}, [] { make_sphere({-2, 1}); });
}

}  // namespace
}  // namespace weft::test
