// Interpolation between views: what splines do at their nodes, of what they reproduce, of smooth
// functions, beyond the views, and of views that determine no surface.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/btf/view_grid.hpp"

namespace weft::test {
namespace {

using Vector = std::array<double, 3>;

// Weights that solve a system of condition 1e4, in double.
constexpr double tolerance = 1e-8;

Direction narrowed(const Vector& d) {
  return {static_cast<float>(d[0]), static_cast<float>(d[1]), static_cast<float>(d[2])};
}

double interpolated(const std::vector<double>& w, const std::vector<Direction>& views,
                    double (*f)(const Vector&)) {
  double sum = 0;
  for (std::size_t v = 0; v < w.size(); ++v) {
    sum += w[v] * f({double{views[v][0]}, double{views[v][1]}, double{views[v][2]}});
  }
  return sum;
}

double bump(const Vector& d) {
  return std::exp(-4 * ((d[0] - 0.3) * (d[0] - 0.3) + d[1] * d[1]));
}

// Whatever the views, weights sum to 1, and are those of the node at a node.
TEST(ResampleViews, ValuesOfMeasuredViewsAreKept) {
  constexpr std::size_t side = 9;
  const ViewGrid grid(side);
  const std::vector<std::vector<std::size_t>> sets{
      {40}, {40, 41}, {12, 30, 41}, {20, 24, 56, 60}, {12, 20, 24, 30, 40, 41, 56, 60, 66}};
  for (const auto& entries : sets) {
    std::vector<Direction> views;
    for (const std::size_t e : entries) views.push_back(narrowed(grid.direction(e)));
    const ViewResampling resampling(views, side);
    for (std::size_t e = 0; e < resampling.size(); ++e) {
      const std::vector<double> w = resampling.weights(e);
      ASSERT_EQ(w.size(), views.size());
      EXPECT_NEAR(std::accumulate(w.begin(), w.end(), 0.0), 1, tolerance);
    }
    for (std::size_t v = 0; v < views.size(); ++v) {
      std::vector<double> unit(views.size(), 0.0);
      unit[v] = 1;
      // nodes are where their entries are, to a float's rounding
      EXPECT_TRUE(all_near(resampling.weights(entries[v]), unit, 1e-5)) << views.size();
    }
  }
}

TEST(ResampleViews, LinearFunctionsAreReproduced) {
  constexpr std::size_t side = 32;
  const std::vector<Direction> views = ubo81_directions();
  const ViewResampling resampling(views, side);
  const ViewGrid grid(side);
  const Hemisphere hull(views);
  const auto linear = [](const Vector& d) { return 0.5 - 2 * d[0] + 0.7 * d[1] + 3 * d[2]; };
  double largest_at_rim = 0;
  for (std::size_t e = 0; e < resampling.size(); ++e) {
    const std::vector<double> w = resampling.weights(e);
    const Vector d = grid.direction(e);
    const double found = interpolated(w, views, linear);
    if (d[2] > std::cos(1.25)) {  // within the ring at 75 degrees
      EXPECT_NEAR(found, linear(d), 1e-5);
    } else if (d[2] == 0) {
      // clamped to the ring at 75 degrees, whose chords are a little above it
      const double theta = 75 * 3.14159265358979 / 180;
      const Vector ring{d[0] * std::sin(theta), d[1] * std::sin(theta), std::cos(theta)};
      largest_at_rim = std::max(largest_at_rim, std::abs(found - linear(ring)));
    }
  }
  EXPECT_LT(largest_at_rim, 0.05);
}

// Of a smooth function the spline errs less than triangles do.
TEST(ResampleViews, SmoothFunctionsAreCloserThanByTriangles) {
  constexpr std::size_t side = 48;
  const std::vector<Direction> views = ubo81_directions();
  const ViewResampling resampling(views, side);
  const Hemisphere hull(views);
  const ViewGrid grid(side);
  double spline = 0;
  double triangles = 0;
  for (std::size_t e = 0; e < resampling.size(); ++e) {
    const Vector d = grid.direction(e);
    if (d[2] < std::cos(1.25)) continue;
    spline = std::max(spline, std::abs(interpolated(resampling.weights(e), views, bump) - bump(d)));
    const DirectionWeights at = hull.at(d);
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Direction& view = views[at.index[k]];
      sum += at.weight[k] * bump({double{view[0]}, double{view[1]}, double{view[2]}});
    }
    triangles = std::max(triangles, std::abs(sum - bump(d)));
  }
  EXPECT_LT(spline, 0.5 * triangles);
}

// Views on a ring, on a great circle, in two places, twice the same: finite weights, bounded.
TEST(ResampleViews, DegenerateViews) {
  std::vector<Direction> ring;
  std::vector<Direction> arc;
  for (int i = 0; i < 8; ++i) {
    ring.push_back(direction_from_degrees(30, 45.0 * i));
    arc.push_back(direction_from_degrees(10.0 * i, 0));
  }
  std::vector<Direction> twice = even_directions(9);
  twice.push_back(twice[3]);
  const std::vector<Direction> opposite{direction_from_degrees(90, 0),
                                        direction_from_degrees(90, 180)};
  for (const auto& views : {ring, arc, twice, opposite}) {
    const ViewResampling resampling(views, 16);
    for (std::size_t e = 0; e < resampling.size(); ++e) {
      const std::vector<double> w = resampling.weights(e);
      EXPECT_NEAR(std::accumulate(w.begin(), w.end(), 0.0), 1, 1e-6);
      for (const double value : w) EXPECT_LT(std::abs(value), 2);
    }
  }
}

}  // namespace
}  // namespace weft::test
