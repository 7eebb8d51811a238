#include "weft/btf/directions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

#include "weft/error.hpp"

namespace weft {
namespace {

// Rounding a unit vector to float moves it by at most half an ulp of 1 per component, 6e-8, that is
// 3.4e-6 degrees along each of two tangents.
constexpr double angle_tolerance = 1e-5;

double length(const Direction& d) {
  return std::hypot(d[0], d[1], d[2]);
}

TEST(Directions, FollowTheConvention) {
  EXPECT_EQ(direction_from_degrees(0, 123), (Direction{0, 0, 1}));
  const Direction x = direction_from_degrees(90, 0);
  EXPECT_NEAR(x[0], 1, 1e-7);
  EXPECT_NEAR(x[2], 0, 1e-7);
  const Direction y = direction_from_degrees(90, 90);
  EXPECT_NEAR(y[1], 1, 1e-7);
  const Direction d = direction_from_degrees(60, 240);
  EXPECT_NEAR(d[0], -std::sqrt(3.0) / 4, 1e-7);
  EXPECT_NEAR(d[1], -0.75, 1e-7);
  EXPECT_NEAR(d[2], 0.5, 1e-7);
}

TEST(Directions, AnglesComeBack) {
  for (double theta = 2.5; theta <= 90; theta += 2.5) {
    for (double phi = 0; phi < 360; phi += 7.5) {
      const Direction d = direction_from_degrees(theta, phi);
      EXPECT_NEAR(theta_degrees(d), theta, angle_tolerance);
      const double turn = std::remainder(phi_degrees(d) - phi, 360.0);
      EXPECT_NEAR(turn, 0, angle_tolerance / std::sin(theta * 3.14159265 / 180))
          << theta << " " << phi;
      EXPECT_GE(phi_degrees(d), 0);
      EXPECT_LT(phi_degrees(d), 360);
    }
  }
}

TEST(Directions, AzimuthAtItsEdges) {
  EXPECT_EQ(phi_degrees({0, 0, 1}), 0);
  EXPECT_EQ(phi_degrees({-0.0f, -0.0f, 1}), 0);
  EXPECT_EQ(phi_degrees({1, -0.0f, 0}), 0);
  EXPECT_FALSE(std::signbit(phi_degrees({1, -0.0f, 0})));
  EXPECT_EQ(phi_degrees({1, -1e-30f, 0}), 0);  // 360 after rounding
  EXPECT_EQ(phi_degrees({-1, -0.0f, 0}), 180);
  EXPECT_EQ(phi_degrees({0, -1, 0}), 270);
  // An arc cosine would give 0 here.
  EXPECT_NEAR(theta_degrees({1e-6f, 0, 1}), 1e-6 * 180 / 3.14159265358979, 1e-11);
}

void expect_rings(const std::vector<Direction>& directions, const std::vector<double>& thetas,
                  const std::vector<std::size_t>& counts, const std::vector<double>& offsets) {
  std::size_t next = 0;
  for (std::size_t ring = 0; ring < thetas.size(); ++ring) {
    for (std::size_t i = 0; i < counts[ring]; ++i, ++next) {
      ASSERT_LT(next, directions.size());
      const Direction& d = directions[next];
      EXPECT_NEAR(length(d), 1, 1e-6);
      EXPECT_NEAR(theta_degrees(d), thetas[ring], angle_tolerance);
      if (thetas[ring] == 0) continue;
      const double phi =
          offsets[ring] + 360.0 * static_cast<double>(i) / static_cast<double>(counts[ring]);
      EXPECT_NEAR(std::remainder(phi_degrees(d) - phi, 360.0), 0, 1e-4) << ring << " " << i;
    }
  }
  EXPECT_EQ(next, directions.size());
}

TEST(Directions, RingsOfTheGoniometer) {
  expect_rings(ubo81_directions(), {0, 15, 30, 45, 60, 75}, {1, 6, 12, 18, 20, 24},
               {0, 0, 0, 0, 0, 0});
  EXPECT_EQ(ubo81_directions().size(), 81u);
}

TEST(Directions, RingsOfTheDome) {
  expect_rings(ubo151_directions(), {0, 11, 23.5, 30, 37.5, 45, 52.5, 60, 67.5, 75},
               {1, 6, 12, 12, 12, 18, 18, 24, 24, 24}, {0, 15, 0, 15, 0, 0, 7.5, 0, 7.5, 0});
  EXPECT_EQ(ubo151_directions().size(), 151u);
}

TEST(Directions, EvenOnesCoverTheCap) {
  EXPECT_EQ(even_directions(1), (std::vector<Direction>{{0, 0, 1}}));
  EXPECT_THROW(even_directions(0), Error);
  for (const std::size_t count : {2u, 7u, 100u, 1000u}) {
    const std::vector<Direction> directions = even_directions(count);
    ASSERT_EQ(directions.size(), count);
    double sum_x = 0, sum_y = 0;
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_NEAR(length(directions[i]), 1, 1e-6);
      EXPECT_LT(theta_degrees(directions[i]), 75);
      if (i > 0) {
        EXPECT_GT(theta_degrees(directions[i]), theta_degrees(directions[i - 1]));
      }
      sum_x += directions[i][0];
      sum_y += directions[i][1];
    }
    // Partial sums of steps of the golden angle stay bounded, so a lean vanishes as 1/count.
    EXPECT_LT(std::hypot(sum_x, sum_y), 1.0);
  }
  // Of n directions of equal area on the cap, none is far nearer to another than sqrt(area/n).
  const std::vector<Direction> directions = even_directions(400);
  const double spacing =
      std::sqrt(2 * 3.14159265 * (1 - std::cos(75 * 3.14159265 / 180)) / 400) * 0.5;
  for (std::size_t i = 0; i < 400; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const Direction &a = directions[i], &b = directions[k];
      EXPECT_GT(std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]), spacing);
    }
  }
}

TEST(Directions, SetsByName) {
  EXPECT_EQ(direction_set("ubo81", "--view-set"), ubo81_directions());
  EXPECT_EQ(direction_set("ubo151", "--view-set"), ubo151_directions());
  EXPECT_EQ(direction_set("17", "--view-set"), even_directions(17));
  for (const std::string bad : {"", "0", "-3", "+3", "ubo80", "UBO81", "12x", " 5", "5 ", "1.5",
                                "1000001", "99999999999999999999999"}) {
    try {
      direction_set(bad, "--light-set");
      ADD_FAILURE() << "'" << bad << "' was taken";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      const std::string message = error.what();
      EXPECT_NE(message.find("--light-set"), std::string::npos) << message;
      EXPECT_NE(message.find("'" + bad + "'"), std::string::npos) << message;
    }
  }
}

}  // namespace
}  // namespace weft
