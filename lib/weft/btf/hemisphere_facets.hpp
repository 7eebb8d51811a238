// The triangles between measured directions; see hemisphere.hpp.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/btf/convex_hull.hpp"

namespace weft {

// Facets of the convex hull of directions[distinct[..]], all of unit length, that are turned away
// from the origin, as triangles of indices into `directions`: counter-clockwise as seen from
// outside, each with its lowest index first, in ascending order.
std::vector<HullFacet> hemisphere_facets(std::span<const std::array<double, 3>> directions,
                                         std::span<const std::uint32_t> distinct);

}  // namespace weft
