#include "weft/btf/hemisphere_facets.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>

namespace weft {
namespace {

using Vector = std::array<double, 3>;
using DirectedEdge = std::array<std::uint32_t, 2>;

// A facet whose plane passes the origin this closely is part of the base.
constexpr double base_distance = 1e-6;
// A point this close to a plane may be off it by rounding: a few times half an ulp of float at 1.
constexpr double same_plane = 5e-7;

Vector difference(const Vector& a, const Vector& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

class Facets {
 public:
  Facets(std::span<const Vector> directions, std::vector<HullFacet> facets)
      : directions_(directions), facets_(std::move(facets)), group_(facets_.size()) {
    std::iota(group_.begin(), group_.end(), std::size_t{0});
    for (std::size_t f = 0; f < facets_.size(); ++f) {
      for (std::size_t k = 0; k < 3; ++k) facet_with_[edge(f, k)] = f;
    }
    for (std::size_t f = 0; f < facets_.size(); ++f) {
      for (std::size_t k = 0; k < 3; ++k) {
        const auto other = across(f, k);
        if (other != facet_with_.end() && coplanar(f, k, other->second)) {
          group_[group_of(f)] = group_of(other->second);
        }
      }
    }
  }

  // The facets, with each polygon of several cut by diagonals from its lowest index.
  std::vector<HullFacet> canonical() {
    std::map<std::size_t, std::vector<std::size_t>> members;
    for (std::size_t f = 0; f < facets_.size(); ++f) members[group_of(f)].push_back(f);
    std::vector<HullFacet> result;
    for (const auto& [root, polygon] : members) {
      const std::vector<HullFacet> cut =
          polygon.size() > 1 ? fan(polygon) : std::vector<HullFacet>();
      if (cut.empty()) {
        for (const std::size_t f : polygon) result.push_back(facets_[f]);
      } else {
        result.insert(result.end(), cut.begin(), cut.end());
      }
    }
    for (HullFacet& facet : result) {
      std::rotate(facet.begin(), std::min_element(facet.begin(), facet.end()), facet.end());
    }
    std::sort(result.begin(), result.end());
    return result;
  }

 private:
  using EdgeMap = std::map<DirectedEdge, std::size_t>;

  DirectedEdge edge(std::size_t facet, std::size_t k) const {
    return {facets_[facet][k], facets_[facet][(k + 1) % 3]};
  }

  EdgeMap::const_iterator across(std::size_t facet, std::size_t k) const {
    const DirectedEdge here = edge(facet, k);
    return facet_with_.find({here[1], here[0]});
  }

  std::size_t group_of(std::size_t facet) {
    while (group_[facet] != facet) facet = group_[facet] = group_[group_[facet]];
    return facet;
  }

  // Two facets with a common edge make a tetrahedron: it is flat where its height over the largest
  // of its four faces is.
  bool coplanar(std::size_t facet, std::size_t k, std::size_t other) const {
    const HullFacet &f = facets_[facet], &g = facets_[other];
    const auto apex = std::find_if(
        g.begin(), g.end(), [&](std::uint32_t v) { return v != f[k] && v != f[(k + 1) % 3]; });
    const std::array<Vector, 4> corners{directions_[f[0]], directions_[f[1]], directions_[f[2]],
                                        directions_[*apex]};
    double largest = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const Vector& a = corners[(i + 1) % 4];
      const Vector normal =
          cross(difference(corners[(i + 2) % 4], a), difference(corners[(i + 3) % 4], a));
      largest = std::max(largest, std::sqrt(dot(normal, normal)));
    }
    const double volume =
        dot(cross(difference(corners[1], corners[0]), difference(corners[2], corners[0])),
            difference(corners[3], corners[0]));
    return std::abs(volume) <= same_plane * largest;
  }

  // Empty where the facets together are no polygon whose fan covers it, as may be where directions
  // are so dense that a whole cap is flat.
  std::vector<HullFacet> fan(const std::vector<std::size_t>& polygon) {
    std::map<std::uint32_t, std::uint32_t> rim;
    for (const std::size_t f : polygon) {
      for (std::size_t k = 0; k < 3; ++k) {
        const auto other = across(f, k);
        if (other != facet_with_.end() && group_of(other->second) == group_of(f)) continue;
        if (!rim.emplace(edge(f, k)[0], edge(f, k)[1]).second) return {};
      }
    }
    if (rim.size() != polygon.size() + 2) return {};
    const std::uint32_t lowest = rim.begin()->first;
    std::vector<HullFacet> result;
    std::uint32_t previous = rim.at(lowest);
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const std::uint32_t next = rim.at(previous);
      const Vector &a = directions_[lowest], &b = directions_[previous], &c = directions_[next];
      if (next == lowest || dot(a, cross(b, c)) <= 0) return {};
      result.push_back({lowest, previous, next});
      previous = next;
    }
    if (rim.at(previous) != lowest) return {};
    return result;
  }

  std::span<const Vector> directions_;
  std::vector<HullFacet> facets_;
  std::vector<std::size_t> group_;  // of a facet: another of its polygon, or itself
  EdgeMap facet_with_;
};

}  // namespace

std::vector<HullFacet> hemisphere_facets(std::span<const Vector> directions,
                                         std::span<const std::uint32_t> distinct) {
  // With the origin as one more point, the base is what touches the origin.
  std::vector<LatticePoint> points{{0, 0, 0}};
  for (const std::uint32_t i : distinct) {
    LatticePoint point{};
    for (std::size_t k = 0; k < 3; ++k) {
      point[k] = std::llrint(directions[i][k] * static_cast<double>(lattice_limit));
    }
    points.push_back(point);
  }
  std::vector<HullFacet> outer;
  for (const HullFacet& facet : convex_hull(points)) {
    if (std::find(facet.begin(), facet.end(), 0u) != facet.end()) continue;
    const HullFacet indices{distinct[facet[0] - 1], distinct[facet[1] - 1], distinct[facet[2] - 1]};
    const Vector &a = directions[indices[0]], &b = directions[indices[1]],
                 &c = directions[indices[2]];
    const Vector normal = cross(difference(b, a), difference(c, a));
    if (dot(normal, a) > base_distance * std::sqrt(dot(normal, normal))) outer.push_back(indices);
  }
  return Facets(directions, std::move(outer)).canonical();
}

}  // namespace weft
