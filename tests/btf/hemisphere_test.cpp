#include "weft/btf/hemisphere.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "weft/btf/convex_hull.hpp"

namespace weft::test {
namespace {

using Vector = std::array<double, 3>;
using Indices = std::array<std::uint32_t, 3>;
using std::numbers::pi;
constexpr double degree = pi / 180;

Vector at_degrees(double theta, double phi) {
  return {std::sin(theta * degree) * std::cos(phi * degree),
          std::sin(theta * degree) * std::sin(phi * degree), std::cos(theta * degree)};
}

Vector unit(const Direction& d) {
  const double l = std::hypot(double{d[0]}, double{d[1]}, double{d[2]});
  return {d[0] / l, d[1] / l, d[2] / l};
}

double dot_of(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double determinant(const Vector& a, const Vector& b, const Vector& c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

std::vector<Direction> ring(double theta, std::size_t count, double first = 0) {
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < count; ++i) {
    directions.push_back(direction_from_degrees(
        theta, first + 360.0 * static_cast<double>(i) / static_cast<double>(count)));
  }
  return directions;
}

std::vector<Direction> joined(std::initializer_list<std::vector<Direction>> parts) {
  std::vector<Direction> all;
  for (const auto& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

std::vector<Direction> scattered(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < count; ++i) {
    directions.push_back(
        direction_from_degrees(std::acos(random.uniform()) / degree, random.uniform(0, 360)));
  }
  return directions;
}

// Sets of every kind, by name.
std::vector<std::pair<std::string, std::vector<Direction>>> all_sets() {
  const std::vector<Direction> zenith{{0, 0, 1}};
  std::vector<Direction> arc, slice;
  for (int i = 0; i <= 6; ++i) arc.push_back(direction_from_degrees(10.0 * i, 40));
  for (int i = -6; i <= 6; ++i)
    slice.push_back(direction_from_degrees(std::abs(15.0 * i), i < 0 ? 180 : 0));
  auto duplicates = ubo81_directions();
  duplicates.insert(duplicates.end(), {duplicates[3], duplicates[40], duplicates[0]});
  std::vector<Direction> cluster;
  for (int i = 0; i < 40; ++i) cluster.push_back(direction_from_degrees(50 + i, 17 * i % 60 - 30));
  return {{"cluster", cluster},
          {"ubo81", ubo81_directions()},
          {"ubo151", ubo151_directions()},
          {"even 2", even_directions(2)},
          {"even 3", even_directions(3)},
          {"even 4", even_directions(4)},
          {"even 40", even_directions(40)},
          {"even 500", even_directions(500)},
          {"one", {direction_from_degrees(30, 77)}},
          {"two", {direction_from_degrees(30, 77), direction_from_degrees(60, 200)}},
          {"opposite", {{1, 0, 0}, {-1, 0, 0}}},
          {"arc", arc},
          {"slice", slice},
          {"ring", ring(50, 7)},
          {"horizon ring", ring(90, 12)},
          {"to the horizon", joined({zenith, ring(45, 8), ring(90, 12)})},
          {"quadrant", {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
          {"duplicates", duplicates},
          {"scattered 30", scattered(30, 1)},
          {"scattered 300", scattered(300, 2)}};
}

void expect_valid(const DirectionWeights& weights, std::size_t count) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_GE(weights.weight[k], 0);
    EXPECT_LT(weights.index[k], count);
    sum += weights.weight[k];
  }
  EXPECT_NEAR(sum, 1, 4 * std::numeric_limits<double>::epsilon());
  EXPECT_GE(weights.scale, 0);
  EXPECT_LE(weights.scale, 4);
}

// sum w_i d_i.
Vector combined(const DirectionWeights& weights, const std::vector<Direction>& directions) {
  Vector p{};
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector d = unit(directions[weights.index[k]]);
    for (std::size_t i = 0; i < 3; ++i) p[i] += weights.weight[k] * d[i];
  }
  return p;
}

double angle(const Vector& a, const Vector& b) {
  const Vector cross{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                     a[0] * b[1] - a[1] * b[0]};
  return std::atan2(std::sqrt(dot_of(cross, cross)), dot_of(a, b));
}

std::vector<Indices> triangles_of(const Hemisphere& hemisphere) {
  std::vector<Indices> triangles;
  for (std::size_t t = 0; t < hemisphere.triangle_count(); ++t) {
    triangles.push_back(hemisphere.triangle(t));
  }
  return triangles;
}

TEST(ConvexHull, OfACubeHasTwelveFacets) {
  std::vector<LatticePoint> points;
  for (int i = 0; i < 8; ++i) {
    const auto coordinate = [i](int bit) {
      return (i >> bit & 1) != 0 ? lattice_limit : -lattice_limit;
    };
    points.push_back({coordinate(0), coordinate(1), coordinate(2)});
  }
  points.push_back({0, 0, 0});  // inside
  std::set<std::array<std::uint32_t, 2>> edges;
  const std::vector<HullFacet> facets = convex_hull(points);
  EXPECT_EQ(facets.size(), 12u);
  for (const HullFacet& facet : facets) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_LT(facet[k], 8u);
      EXPECT_TRUE(edges.insert({facet[k], facet[(k + 1) % 3]}).second);
    }
  }
  for (const auto& [a, b] : edges) EXPECT_TRUE(edges.contains({b, a}));
}

TEST(ConvexHull, OfFlatSetsIsEmpty) {
  EXPECT_TRUE(convex_hull({}).empty());
  const std::vector<LatticePoint> line{{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {5, 5, 5}, {9, 9, 9}};
  EXPECT_TRUE(convex_hull(line).empty());
  const std::vector<LatticePoint> plane{{0, 0, 3}, {1, 0, 3}, {0, 1, 3}, {1, 1, 3}, {4, 7, 3}};
  EXPECT_TRUE(convex_hull(plane).empty());
}

// No measured direction lies beyond the plane of a triangle.
TEST(Hemisphere, TrianglesAreFacetsOfTheHull) {
  for (const auto& [name, directions] : all_sets()) {
    const Hemisphere hemisphere(directions);
    for (const Indices& t : triangles_of(hemisphere)) {
      const Vector a = unit(directions[t[0]]), b = unit(directions[t[1]]),
                   c = unit(directions[t[2]]);
      EXPECT_GT(determinant(a, b, c), 0) << name;
      EXPECT_LT(t[0], std::min(t[1], t[2])) << name;
      for (std::size_t i = 0; i < directions.size(); ++i) {
        const Vector d = unit(directions[i]);
        const auto minus = [&](const Vector& p) {
          return Vector{p[0] - a[0], p[1] - a[1], p[2] - a[2]};
        };
        // Directions of one facet may lie off its plane by 5e-7 of the largest face, of area < 2.
        EXPECT_LE(determinant(minus(b), minus(c), minus(d)), 2e-6) << name << " " << i;
      }
    }
    const auto triangles = triangles_of(hemisphere);
    EXPECT_TRUE(std::is_sorted(triangles.begin(), triangles.end())) << name;
  }
}

// Euler: a triangulated disc of n points with b of them on its edge has 2 n - 2 - b triangles.
TEST(Hemisphere, CountsOfTrianglesFollowFromTheRings) {
  EXPECT_EQ(Hemisphere(ubo81_directions()).triangle_count(), 2u * 81 - 2 - 24);
  EXPECT_EQ(Hemisphere(ubo151_directions()).triangle_count(), 2u * 151 - 2 - 24);
  EXPECT_EQ(Hemisphere(ring(50, 7)).triangle_count(), 5u);
  EXPECT_EQ(Hemisphere(ring(90, 12)).triangle_count(), 0u);
  EXPECT_EQ(Hemisphere(joined({{{0, 0, 1}}, ring(90, 12)})).triangle_count(), 12u);
  EXPECT_EQ(Hemisphere(even_directions(2)).triangle_count(), 0u);
}

// A facet with more than three directions is cut from its lowest index.
TEST(Hemisphere, TiesGoToTheLowestIndex) {
  const std::vector<Indices> fan{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}};
  EXPECT_EQ(triangles_of(Hemisphere(ring(50, 7))), fan);
  // Two rings of six, one above the other: six trapezoids, each cut from its lowest index, and the
  // hexagon on top.
  const std::vector<Indices> expected{
      {0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 11}, {0, 6, 7},  {0, 7, 1},   {0, 11, 6},
      {1, 7, 8}, {1, 8, 2}, {2, 8, 9}, {2, 9, 3}, {3, 9, 10}, {3, 10, 4}, {4, 10, 11}, {4, 11, 5}};
  EXPECT_EQ(triangles_of(Hemisphere(joined({ring(30, 6), ring(60, 6)}))), expected);
}

// Turning a set by what maps each ring onto itself, or adding float noise, keeps the triangles.
TEST(Hemisphere, TrianglesOfRingsIgnoreRounding) {
  for (const auto& directions :
       {ubo81_directions(), ubo151_directions(), joined({ring(30, 6), ring(60, 6), ring(90, 6)})}) {
    const auto expected = triangles_of(Hemisphere(directions));
    Random random(5);
    for (int trial = 0; trial < 20; ++trial) {
      std::vector<Direction> noisy = directions;
      for (Direction& d : noisy) {
        for (float& x : d) {
          const std::size_t step = random.index(3);
          if (step != 1 && std::abs(x) > 1e-3f) x = std::nextafter(x, step == 0 ? -2.0f : 2.0f);
        }
      }
      EXPECT_EQ(triangles_of(Hemisphere(noisy)), expected);
    }
  }
}

TEST(Hemisphere, IsExactAtMeasuredDirections) {
  for (const auto& [name, directions] : all_sets()) {
    const Hemisphere hemisphere(directions);
    for (std::size_t i = 0; i < directions.size(); ++i) {
      const Vector d = unit(directions[i]);
      const DirectionWeights weights = hemisphere.at(d);
      expect_valid(weights, directions.size());
      // Of duplicates the first answers.
      const std::size_t first = static_cast<std::size_t>(
          std::find(directions.begin(), directions.end(), directions[i]) - directions.begin());
      double total = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        if (weights.index[k] == first) total += weights.weight[k];
      }
      EXPECT_NEAR(total, 1, 1e-9) << name << " " << i;
      if (d[2] > 1e-6) {
        EXPECT_NEAR(weights.scale, 1, 1e-9) << name << " " << i;
      }
    }
  }
}

// Inside the hull the weights reproduce the direction; outside they give the nearest point of it.
TEST(Hemisphere, ReproducesInsideAndClampsOutside) {
  for (const auto& [name, directions] : all_sets()) {
    const Hemisphere hemisphere(directions);
    const auto triangles = triangles_of(hemisphere);
    Random random(11);
    for (int trial = 0; trial < 2000; ++trial) {
      const Vector d = at_degrees(std::acos(random.uniform()) / degree, random.uniform(0, 360));
      const DirectionWeights weights = hemisphere.at(d);
      expect_valid(weights, directions.size());
      const bool inside = std::any_of(triangles.begin(), triangles.end(), [&](const Indices& t) {
        const Vector a = unit(directions[t[0]]), b = unit(directions[t[1]]),
                     c = unit(directions[t[2]]);
        return determinant(d, b, c) >= 0 && determinant(a, d, c) >= 0 && determinant(a, b, d) >= 0;
      });
      const double off = name == "opposite" ? 0 : angle(d, combined(weights, directions));
      if (inside) {
        EXPECT_LT(off, 1e-9) << name;
        EXPECT_EQ(weights.scale, 1) << name;
        continue;
      }
      // Nothing on the edge of the hull, finely sampled, is nearer; of an edge more than a quarter
      // turn away any point will do.
      if (triangles.empty() || trial % 20 != 0 || off > pi / 2) continue;
      const HemisphereTables tables = hemisphere.tables();
      double nearest = 10;
      for (std::size_t e = 0; e < tables.edges.size(); e += 4) {
        const Vector a = unit(directions[static_cast<std::size_t>(tables.edges[e])]);
        const Vector b = unit(directions[static_cast<std::size_t>(tables.edges[e + 1])]);
        for (int s = 0; s <= 64; ++s) {
          const double f = s / 64.0;
          Vector p{};
          for (std::size_t i = 0; i < 3; ++i) p[i] = (1 - f) * a[i] + f * b[i];
          nearest = std::min(nearest, angle(d, p));
        }
      }
      EXPECT_LE(off, nearest + 1e-9) << name;
    }
  }
}

// The weight of each direction, and the scale.
std::vector<double> weights_at(const Hemisphere& hemisphere, const Vector& d, std::size_t count) {
  std::vector<double> all(count + 1);
  const DirectionWeights weights = hemisphere.at(d);
  all[count] = weights.scale;
  for (std::size_t k = 0; k < 3; ++k) all[weights.index[k]] += weights.weight[k];
  return all;
}

double largest_change(const std::vector<double>& a, const std::vector<double>& b) {
  double change = 0;
  for (std::size_t i = 0; i < a.size(); ++i) change = std::max(change, std::abs(a[i] - b[i]));
  return change;
}

// Along great and small circles the weights change by little from step to step: over edges, past
// vertices, from inside to outside and over the zenith. Where they change by more, in narrow
// triangles, they do so less and less over ever shorter steps.
TEST(Hemisphere, IsContinuous) {
  for (const auto& [name, directions] : all_sets()) {
    // The nearest point of an arc jumps where a path crosses its pole, and what is more than a
    // quarter turn away has none.
    if (name == "cluster" || name == "two" || name == "arc" || name == "slice" ||
        name == "even 2" || name == "horizon ring") {
      continue;
    }
    const Hemisphere hemisphere(directions);
    const std::size_t n = directions.size();
    Random random(3);
    for (int path = 0; path < 30; ++path) {
      const double theta = random.uniform(0, 90), phi = random.uniform(0, 360);
      const auto along = [&](double f) {
        return path % 2 == 0 ? at_degrees(theta, 360 * f) : at_degrees(180 * f - 90, phi);
      };
      constexpr int steps = 1000;
      std::vector<double> before = weights_at(hemisphere, along(0), n);
      for (int s = 1; s <= steps; ++s) {
        const std::vector<double> now = weights_at(hemisphere, along(s / double{steps}), n);
        if (largest_change(before, now) > 0.03) {
          // Halve the step, towards the larger change.
          double low = (s - 1) / double{steps}, high = s / double{steps};
          std::vector<double> at_low = before, at_high = now;
          for (int halving = 0; halving < 24; ++halving) {
            const double middle = (low + high) / 2;
            const std::vector<double> between = weights_at(hemisphere, along(middle), n);
            if (largest_change(at_low, between) > largest_change(between, at_high)) {
              high = middle;
              at_high = between;
            } else {
              low = middle;
              at_low = between;
            }
          }
          EXPECT_LT(largest_change(at_low, at_high), 1e-3)
              << name << " path " << path << " at " << low;
        }
        before = now;
      }
    }
  }
}

TEST(Hemisphere, ScalesByTheCosineBelowTheLastRing) {
  const Hemisphere hemisphere(ubo81_directions());
  // At the azimuth of a measured direction the nearest point is that direction.
  for (const double theta : {75.0, 78.0, 85.0, 89.9}) {
    const DirectionWeights weights = hemisphere.at(at_degrees(theta, 30));
    EXPECT_NEAR(weights.scale, std::cos(theta * degree) / std::cos(75 * degree), 1e-6);
    EXPECT_NEAR(*std::max_element(weights.weight.begin(), weights.weight.end()), 1, 1e-6);
  }
  EXPECT_EQ(hemisphere.at(at_degrees(74, 30)).scale, 1);
  // Nothing but the cosine is lost on the way to the horizon: a / pi cos(theta) stays what it is.
  const auto directions = ubo81_directions();
  for (int i = 0; i < 1000; ++i) {
    const Vector d = at_degrees(75 + 0.015 * i, 0.377 * i);
    const DirectionWeights weights = hemisphere.at(d);
    const Vector p = combined(weights, directions);
    EXPECT_NEAR(weights.scale * p[2] / std::sqrt(dot_of(p, p)), d[2], 1e-12);
  }
}

TEST(Hemisphere, BringsDirectionsBelowTheHorizonToIt) {
  for (const auto& [name, directions] : all_sets()) {
    const Hemisphere hemisphere(directions);
    for (int i = 0; i < 36; ++i) {
      const DirectionWeights below = hemisphere.at(at_degrees(100, 10.0 * i));
      const Vector level = at_degrees(90, 10.0 * i);
      const DirectionWeights horizon = hemisphere.at({level[0], level[1], 0});
      expect_valid(below, directions.size());
      EXPECT_EQ(below.scale, 0) << name;
      const Vector p = combined(below, directions), q = combined(horizon, directions);
      EXPECT_LT(std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]), 1e-7) << name;
    }
    expect_valid(hemisphere.at({0, 0, -1}), directions.size());
    expect_valid(hemisphere.at({0, 0, 1e-200}), directions.size());
    expect_valid(hemisphere.at({1e200, 0, 1e200}), directions.size());
  }
}

TEST(Hemisphere, OfTwoDirectionsInterpolatesAlongTheirArc) {
  const Hemisphere two(
      std::vector<Direction>{direction_from_degrees(20, 0), direction_from_degrees(60, 0)});
  const DirectionWeights middle = two.at(at_degrees(40, 0));
  EXPECT_NEAR(middle.weight[0], 0.5, 1e-6);
  EXPECT_NEAR(middle.weight[1], 0.5, 1e-6);
  const DirectionWeights before = two.at(at_degrees(5, 0)), beyond = two.at(at_degrees(80, 0));
  EXPECT_EQ(before.index[0], 0u);
  EXPECT_EQ(before.weight[0], 1);
  EXPECT_EQ(beyond.index[0], 1u);
  EXPECT_EQ(beyond.weight[0], 1);
  EXPECT_NEAR(beyond.scale, std::cos(80 * degree) / std::cos(60 * degree), 1e-6);

  const Hemisphere opposite(std::vector<Direction>{{1, 0, 0}, {-1, 0, 0}});
  const DirectionWeights above = opposite.at({0.6, 0, 0.8});
  EXPECT_NEAR(above.weight[0], 0.8, 1e-12);
  EXPECT_NEAR(above.weight[1], 0.2, 1e-12);
}

// A walk by the tables alone, in float, as a device does it: the direction that its weights make.
Vector walk_tables(const HemisphereTables& tables, const Vector& d) {
  const auto weight = [&](const std::vector<float>& rows, std::size_t row) {
    const float* const r = &rows[4 * row];
    return r[0] * static_cast<float>(d[0]) + r[1] * static_cast<float>(d[1]) +
           r[2] * static_cast<float>(d[2]) + r[3];
  };
  const auto sum = [&](std::initializer_list<std::pair<std::int32_t, float>> taps) {
    Vector p{};
    for (const auto& [index, w] : taps) {
      for (std::size_t i = 0; i < 3; ++i) {
        p[i] += double{std::max(w, 0.0f)} *
                double{tables.directions[4 * static_cast<std::size_t>(index) + i]};
      }
    }
    return p;
  };
  const auto cell = [&](double x) {
    const auto position =
        static_cast<std::size_t>((x / (1 + d[2]) + 1) / 2 * static_cast<double>(tables.side));
    return std::min(position, tables.side - 1);
  };
  std::int32_t place = tables.grid[cell(d[1]) * tables.side + cell(d[0])], left = place;
  while (place >= 0) {
    const auto t = static_cast<std::size_t>(place);
    const std::array<float, 3> w{weight(tables.triangle_rows, 3 * t),
                                 weight(tables.triangle_rows, 3 * t + 1),
                                 weight(tables.triangle_rows, 3 * t + 2)};
    const auto k = static_cast<std::size_t>(std::min_element(w.begin(), w.end()) - w.begin());
    const std::int32_t* const triangle = &tables.triangles[6 * t];
    const std::int32_t next = triangle[3 + k];
    if (w[k] >= -1e-6f || next == left) {
      return sum({{triangle[0], w[0]}, {triangle[1], w[1]}, {triangle[2], w[2]}});
    }
    left = place;
    place = next;
  }
  auto e = static_cast<std::size_t>(~place);
  std::int32_t came = 0;
  while (true) {
    const std::int32_t* const edge = &tables.edges[4 * e];
    const float wa = weight(tables.edge_rows, 2 * e), wb = weight(tables.edge_rows, 2 * e + 1);
    if (wa >= 0 && wb >= 0 && wa + wb > 0) return sum({{edge[0], wa}, {edge[1], wb}});
    const std::int32_t step = wa < wb ? 1 : -1;
    const std::int32_t next = step > 0 ? edge[3] : edge[2];
    if (next < 0 || came == -step) return sum({{edge[step > 0 ? 1 : 0], 1.0f}});
    came = step;
    e = static_cast<std::size_t>(next);
  }
}

TEST(Hemisphere, TablesGiveTheSameWeights) {
  for (const auto& [name, directions] : all_sets()) {
    const Hemisphere hemisphere(directions);
    const HemisphereTables tables = hemisphere.tables();
    ASSERT_EQ(tables.grid.size(), tables.side * tables.side);
    Random random(23);
    for (int trial = 0; trial < 2000; ++trial) {
      const Vector d = at_degrees(std::acos(random.uniform()) / degree, random.uniform(0, 360));
      const Vector p = combined(hemisphere.at(d), directions);
      // The walk stops at weights above -1e-6, which become 0; and rows as long as 1 / a, a the
      // triangle's shortest altitude, 0.01 in the scattered sets, lose 4 roundings of 2^-24 / a.
      EXPECT_LT(angle(p, walk_tables(tables, d)), 3e-5) << name << " " << trial;
    }
  }
}

TEST(Hemisphere, OfManyDirectionsIsQuickToWalk) {
  const auto directions = even_directions(5000);
  const Hemisphere hemisphere(directions);
  EXPECT_GT(hemisphere.triangle_count(), 2u * 5000 - 400);
  const DirectionWeights weights = hemisphere.at(at_degrees(33, 44));
  EXPECT_LT(angle(combined(weights, directions), at_degrees(33, 44)), 1e-9);
}

TEST(Hemisphere, RefusesWhatIsNoDirection) {
  const auto make = [](std::vector<Direction> directions) { Hemisphere{directions}; };
  expect_error(ErrorKind::input, {"at least 1"}, [&] { make({}); });
  expect_error(ErrorKind::input, {"direction 1", "(0, 0, 0)"}, [&] {
    make({{0, 0, 1}, {0, 0, 0}});
  });
  expect_error(ErrorKind::input, {"direction 0", "inf"}, [&] {
    make({{std::numeric_limits<float>::infinity(), 0, 0}});
  });
  expect_error(ErrorKind::input, {"direction 0", "nan"}, [&] {
    make({{std::numeric_limits<float>::quiet_NaN(), 0, 0}});
  });
}

}  // namespace
}  // namespace weft::test
