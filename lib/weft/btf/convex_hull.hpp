// The convex hull of points in space, exact: points lie on an integer lattice, and every decision
// is the sign of a determinant of integers.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace weft {

using LatticePoint = std::array<std::int64_t, 3>;

// The largest magnitude of a coordinate: determinants of differences stay below 2^124.
inline constexpr std::int64_t lattice_limit = std::int64_t{1} << 39;

// Three points by index, counter-clockwise as seen from outside.
using HullFacet = std::array<std::uint32_t, 3>;

// Triangles that cover the hull of distinct points. Where more than three points share a facet's
// plane, the facet is cut into triangles in one of the possible ways. Empty where all points lie on
// one plane. By insertion in lexicographic order, with the facets seen from each new point replaced
// (de Berg et al., Computational Geometry, section 11.2).
std::vector<HullFacet> convex_hull(std::span<const LatticePoint> points);

}  // namespace weft
