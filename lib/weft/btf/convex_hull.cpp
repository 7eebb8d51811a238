#include "weft/btf/convex_hull.hpp"

#include <algorithm>
#include <numeric>

namespace weft {
namespace {

__extension__ using Wide = __int128;

// Six times the volume of the tetrahedron a b c p: positive where p lies on the outer side of the
// facet a b c.
Wide orientation(const LatticePoint& a, const LatticePoint& b, const LatticePoint& c,
                 const LatticePoint& p) {
  const auto edge = [&a](const LatticePoint& q) {
    return std::array<Wide, 3>{Wide{q[0]} - a[0], Wide{q[1]} - a[1], Wide{q[2]} - a[2]};
  };
  const auto u = edge(b), v = edge(c), w = edge(p);
  return (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1] +
         (u[0] * v[1] - u[1] * v[0]) * w[2];
}

bool collinear(const LatticePoint& a, const LatticePoint& b, const LatticePoint& c) {
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const Wide ui = Wide{b[i]} - a[i], uj = Wide{b[j]} - a[j];
    const Wide vi = Wide{c[i]} - a[i], vj = Wide{c[j]} - a[j];
    if (ui * vj != uj * vi) return false;
  }
  return true;
}

// A triangle of the growing hull; neighbour k lies across the edge from vertex k to vertex k + 1.
struct Triangle {
  std::array<std::uint32_t, 3> vertices;
  std::array<std::uint32_t, 3> neighbours{};
  bool alive = true;
};

class Hull {
 public:
  explicit Hull(std::span<const LatticePoint> points)
      : points_(points), starting_at_(points.size()), ending_at_(points.size()) {}

  // The first triangles, of four points that span space.
  void start(std::array<std::uint32_t, 4> corners) {
    if (side({corners[0], corners[1], corners[2]}, corners[3]) > 0) {
      std::swap(corners[1], corners[2]);
    }
    const auto [a, b, c, d] = corners;
    triangles_ = {{{a, b, c}, {1, 2, 3}},
                  {{a, d, b}, {3, 2, 0}},
                  {{b, d, c}, {1, 3, 0}},
                  {{c, d, a}, {2, 1, 0}}};
  }

  // Replaces what point p sees by triangles that join it to the rim of what it sees.
  void insert(std::uint32_t p) {
    // What was made last is what the next point in order is likely to see.
    std::size_t first = triangles_.size();
    while (first > 0 && !sees(p, first - 1)) --first;
    if (first == 0) return;  // inside
    std::vector<std::uint32_t> seen{static_cast<std::uint32_t>(first - 1)};
    triangles_[seen[0]].alive = false;
    struct RimEdge {
      std::uint32_t from, to, outside;
    };
    std::vector<RimEdge> rim;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Triangle triangle = triangles_[seen[i]];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t neighbour = triangle.neighbours[k];
        if (!triangles_[neighbour].alive) continue;
        if (sees(p, neighbour)) {
          triangles_[neighbour].alive = false;
          seen.push_back(neighbour);
        } else {
          rim.push_back({triangle.vertices[k], triangle.vertices[(k + 1) % 3], neighbour});
        }
      }
    }
    for (const RimEdge& edge : rim) {
      const auto made = static_cast<std::uint32_t>(triangles_.size());
      triangles_.push_back({{edge.from, edge.to, p}, {edge.outside, 0, 0}});
      starting_at_[edge.from] = made;
      ending_at_[edge.to] = made;
      Triangle& outside = triangles_[edge.outside];
      for (std::size_t k = 0; k < 3; ++k) {
        if (outside.vertices[k] == edge.to && outside.vertices[(k + 1) % 3] == edge.from) {
          outside.neighbours[k] = made;
        }
      }
    }
    for (const RimEdge& edge : rim) {
      Triangle& made = triangles_[starting_at_[edge.from]];
      made.neighbours[1] = starting_at_[edge.to];
      made.neighbours[2] = ending_at_[edge.from];
    }
  }

  std::vector<HullFacet> facets() const {
    std::vector<HullFacet> facets;
    for (const Triangle& triangle : triangles_) {
      if (triangle.alive) facets.push_back(triangle.vertices);
    }
    return facets;
  }

  Wide side(const HullFacet& facet, std::uint32_t p) const {
    return orientation(points_[facet[0]], points_[facet[1]], points_[facet[2]], points_[p]);
  }

 private:
  bool sees(std::uint32_t p, std::size_t triangle) const {
    return triangles_[triangle].alive && side(triangles_[triangle].vertices, p) > 0;
  }

  std::span<const LatticePoint> points_;
  std::vector<Triangle> triangles_;
  // Of the triangles made last: the one whose edge on the rim starts, or ends, at a point.
  std::vector<std::uint32_t> starting_at_, ending_at_;
};

}  // namespace

std::vector<HullFacet> convex_hull(std::span<const LatticePoint> points) {
  std::vector<std::uint32_t> order(points.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t i, std::uint32_t j) { return points[i] < points[j]; });
  Hull hull(points);
  // Bring four points that span space to the front.
  const auto bring = [&](std::size_t position, const auto& fits) {
    const auto begin = order.begin() + static_cast<std::ptrdiff_t>(position);
    const auto found = std::find_if(begin, order.end(), fits);
    if (found == order.end()) return false;
    std::rotate(begin, found, found + 1);
    return true;
  };
  if (points.size() < 4 ||
      !bring(2,
             [&](std::uint32_t i) {
               return !collinear(points[order[0]], points[order[1]], points[i]);
             }) ||
      !bring(3, [&](std::uint32_t i) {
        return hull.side({order[0], order[1], order[2]}, i) != 0;
      })) {
    return {};
  }
  hull.start({order[0], order[1], order[2], order[3]});
  for (std::size_t i = 4; i < order.size(); ++i) hull.insert(order[i]);
  return hull.facets();
}

}  // namespace weft
