// Directions of the upper hemisphere and the usual sets of them.
//
// A direction is a unit vector, z = the surface's normal; theta is measured from the zenith, phi is
// the azimuth from +x towards +y. Degrees in files and options, radians nowhere in an interface.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

namespace weft {

using Direction = std::array<float, 3>;

// (sin t cos p, sin t sin p, cos t), computed in double.
Direction direction_from_degrees(double theta, double phi);

double theta_degrees(const Direction& direction);
// In [0, 360); 0 at the zenith.
double phi_degrees(const Direction& direction);

// The rings of the Bonn goniometer of 2003: theta 0..75 step 15 with 1, 6, 12, 18, 20, 24.
std::vector<Direction> ubo81_directions();

// The 151 directions of the Bonn dome of 2014: theta 0, 11, 23.5, 30, 37.5, 45, 52.5, 60, 67.5, 75
// with 1, 6, 12, 12, 12, 18, 18, 24, 24, 24 and azimuth offsets 0, 15, 0, 15, 0, 0, 7.5, 0, 7.5, 0.
std::vector<Direction> ubo151_directions();

// `count` >= 1 directions spread evenly over the spherical cap theta <= 75 degrees, by the golden
// angle, equal areas; the first is nearest to the zenith. One direction is the zenith itself.
std::vector<Direction> even_directions(std::size_t count);

// "ubo81", "ubo151" or a count. Throws an input error for anything else; `option` names the option
// in its message.
std::vector<Direction> direction_set(std::string_view name, std::string_view option);

}  // namespace weft
