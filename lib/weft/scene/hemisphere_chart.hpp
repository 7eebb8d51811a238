// The hemisphere of directions as the unit square, by a map that keeps areas: continuous and one to
// one inside, with the same solid angle, 2 pi, for the same area everywhere.
//
// The square's concentric squares become concentric circles (P. Shirley, K. Chiu: A Low Distortion
// Map Between Disk and Square, Journal of Graphics Tools 2, 1997), and the disk the hemisphere by
// Lambert's azimuthal projection: a point of the disk at radius r lies at z = 1 - r^2.
#pragma once

#include <array>

namespace weft {

// Of a place in [0, 1]^2, a direction of unit length with z >= 0.
std::array<double, 3> hemisphere_of_square(const std::array<double, 2>& place);
// Of a direction of unit length with z >= 0, a place in [0, 1]^2.
std::array<double, 2> square_of_hemisphere(const std::array<double, 3>& direction);

}  // namespace weft
