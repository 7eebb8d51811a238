#include "weft/btf/view_grid.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "support/generators.hpp"

namespace weft::test {
namespace {

using Vector = std::array<double, 3>;

double dot_of(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

TEST(ViewGrid, EntriesAreWhereTheirDirectionsAre) {
  for (const std::size_t side : Sizes{1, 2, 3, 16, 33}) {
    const ViewGrid grid(side);
    std::size_t above = 0;
    for (std::size_t e = 0; e < grid.size(); ++e) {
      const Vector d = grid.direction(e);
      EXPECT_NEAR(dot_of(d, d), 1, 1e-12);
      EXPECT_GE(d[2], 0);
      if (d[2] == 0) continue;
      ++above;
      EXPECT_EQ(grid.entry(d), e);
      EXPECT_EQ(grid.entry({3 * d[0], 3 * d[1], 3 * d[2]}), e);
    }
    // the disc takes pi / 4 of the square, to within the entries that its edge cuts
    const double part = static_cast<double>(above) / static_cast<double>(grid.size());
    EXPECT_NEAR(part, 0.785, 4.0 / static_cast<double>(side));
  }
}

// By hand: of 4 x 4 entries the middle four meet at the zenith, (x, y) / (1 + z) is 0.414 at 45
// degrees and 1 at the horizon.
TEST(ViewGrid, KnownDirections) {
  const ViewGrid grid(4);
  EXPECT_EQ(grid.entry({0, 0, 1}), 2U * 4 + 2);
  EXPECT_EQ(grid.entry({1, 0, 1}), 2U * 4 + 2);
  EXPECT_EQ(grid.entry({1, 0, 0}), 2U * 4 + 3);
  EXPECT_EQ(grid.entry({-1, -1e-9, 0}), 1U * 4 + 0);
  EXPECT_EQ(grid.entry({0, 1, 0}), 3U * 4 + 2);
  // below the horizon: at the horizon
  EXPECT_EQ(grid.entry({0, 5, -7}), 3U * 4 + 2);
  EXPECT_EQ(grid.entry({0, 0, -1}), 2U * 4 + 3);
  const Vector corner = grid.direction(15);
  EXPECT_NEAR(corner[0], std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(corner[1], std::sqrt(0.5), 1e-12);
  EXPECT_EQ(corner[2], 0);
}

// Directions that are one entry's side apart at most are in the same entry or in neighbours.
TEST(ViewGrid, NearDirectionsAreInNearEntries) {
  const ViewGrid grid(64);
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const Vector d{random.normal(), random.normal(), std::abs(random.normal())};
    const double length = std::sqrt(dot_of(d, d));
    const std::size_t e = grid.entry(d);
    EXPECT_LT(e, grid.size());
    // the centre is at most half a diagonal away, 2 / 64 sqrt(1/2) in the plane, stretched by up to
    // 2 at the zenith
    EXPECT_GT(dot_of(grid.direction(e), d) / length, std::cos(2 * 2.0 / 64 * std::sqrt(0.5)));
  }
}

}  // namespace
}  // namespace weft::test
