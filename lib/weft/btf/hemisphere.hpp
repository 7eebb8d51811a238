// Measured directions, triangulated, to look up what lies between them.
//
// The triangles are the facets of the convex hull of the unit vectors d_i without its base: those
// whose outer side is turned away from the origin. Together they cover the spherical convex hull of
// the set. A facet of more than three directions is a polygon, cut by diagonals from its direction
// of lowest index; directions count as lying on one plane where rounding them to float could have
// moved them off it, so that rings give the same triangles everywhere. Directions closer together
// than 1e-5 radians are one, the one of lowest index.
//
// Inside a triangle the weights of a direction d solve
//
//   [d_0 d_1 d_2] w = d,    normalised to sum 1.
//
// They are continuous over the hemisphere, not negative, and 1 at a measured direction. Outside, d
// is clamped to the nearest point of the hull's edge (the angle between them is least; where all of
// the hull is more than 90 degrees away, to one of its corners), and `scale`
// is cos(theta) / cos(theta, clamped) for values that contain the cosine of the light; it is at
// most 4, so that a set which ends near the horizon is not blown up. A direction below the horizon
// is first brought to the horizon at its azimuth (straight down: to azimuth 0), and has scale 0.
//
// Sets without area: one direction is the answer to everything; directions on one great circle form
// a chain of arcs (closed where they go all round), and whatever lies off the chain is clamped to
// it; of two opposite directions on the horizon a has weight (1 + d.a) / 2.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/btf/directions.hpp"

namespace weft {

// What is measured at index[k] counts by weight[k]. Weights that are not used are 0, with a valid
// index; all sum to 1.
struct DirectionWeights {
  std::array<std::uint32_t, 3> index{};
  std::array<double, 3> weight{1, 0, 0};
  // For values that contain the cosine of the light's direction (`radiance`); 1 inside the hull.
  double scale = 1;
};

// What a walk on a device needs. A place is a triangle t >= 0, or ~e of an edge of the hull.
//
//   1. Bring d with z < 0 to the horizon, and normalise it.
//   2. Place: grid[row][column] of the stereographic projection (x, y) / (1 + z) in [-1, 1]^2:
//      column = min(int((x / (1 + z) + 1) / 2 side), side - 1), row likewise of y.
//   3. In triangle t: w_k = row[t][k].(d, 1), k = 0..2. Done where all w_k >= -tolerance (1e-12 in
//      double, a few eps of float in float). Otherwise go on at the neighbour of the smallest w_k;
//      where that is the triangle just left (a tie that rounding decides in both), stay.
//   4. On an edge (~e): w_a = row[e][0].(d, 1), w_b = row[e][1].(d, 1). Done where neither is
//      negative. With w_a < w_b, d lies beyond b: go on at the next edge; otherwise at the previous
//      one. Where there is none (-1), or where it was just left, the answer is the vertex between.
//   5. Negative weights become 0; divide by the sum. On edges and vertices, scale follows from
//      p = sum w_k d_k and p_z / |p|.
struct HemisphereTables {
  std::vector<float> directions;        // [n][4]: x, y, z, 0
  std::vector<std::int32_t> triangles;  // [T][6]: three directions, counter-clockwise as seen from
                                        // outside; the places across from each of them
  std::vector<float> triangle_rows;     // [T][3][4]
  std::vector<std::int32_t> edges;      // [E][4]: directions a, b; previous edge, next edge, or -1
  std::vector<float> edge_rows;         // [E][2][4]
  std::vector<std::int32_t> grid;       // [side][side] triangles; ~0 where there are none
  std::size_t side = 0;
};

class Hemisphere {
 public:
  // Any set of at least one direction of finite length above 0. Throws an input error that names
  // the index and the value otherwise.
  explicit Hemisphere(std::span<const Direction> directions);

  // Of any vector of finite length above 0.
  DirectionWeights at(const std::array<double, 3>& direction) const;

  // Three directions each, the lowest index first, counter-clockwise as seen from outside; in
  // ascending order.
  std::size_t triangle_count() const { return triangles_.size(); }
  std::array<std::uint32_t, 3> triangle(std::size_t t) const { return triangles_[t].vertices; }

  HemisphereTables tables() const;

 private:
  using Vector = std::array<double, 3>;
  // w = row[0..2].d + row[3]
  using Row = std::array<double, 4>;
  struct Triangle {
    std::array<std::uint32_t, 3> vertices{};
    std::array<std::int32_t, 3> neighbours{};  // across from each vertex
    std::array<Row, 3> rows{};
  };
  struct Edge {
    std::array<std::uint32_t, 2> vertices{};
    std::int32_t previous = -1, next = -1;
    std::array<Row, 2> rows{};
  };

  void make_chain(std::span<const std::uint32_t> distinct, const Vector& normal);
  void make_triangles(std::span<const std::uint32_t> distinct);
  void connect_triangles();
  void add_edge(std::uint32_t a, std::uint32_t b);
  void make_grid();
  Vector upper(const Vector& direction) const;
  std::int32_t start(const Vector& d) const;
  std::int32_t walk(std::int32_t place, const Vector& d) const;
  DirectionWeights on_edge(std::size_t edge, const Vector& d) const;

  std::vector<Vector> directions_;
  std::vector<Triangle> triangles_;
  std::vector<Edge> edges_;
  std::vector<std::int32_t> grid_;
  std::size_t side_ = 0;
};

}  // namespace weft
