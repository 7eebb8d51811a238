// A knotted net: cords that run in zigzag and are knotted to their neighbours, with holes between
// them. Lengths in millimetres. One layer, with an underside.
//
//      \    /\    /\          cord j+1        knots lie on a grid of mesh x mesh / 2 whose rows
//       \  /  \  /  \                         are shifted by half a mesh against each other
//        ()    ()    ()       knots
//       /  \  /  \  /         cord j
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct Net {
  std::size_t meshes = 7;  // side by side of one tile
  std::size_t rows = 8;    // rows of knots of one tile, an even number
  std::uint64_t seed = 1;
  std::array<float, 3> color{0.34f, 0.27f, 0.15f};
  GlossyLobe gloss{{0.03f, 0.03f, 0.03f}, 0.8f, 0.35f, 0.6f};
  double color_spread = 0.12;  // relative
  double mesh = 12;            // width of a mesh
  double row_height = 10.5;    // distance of the rows of knots
  double width = 2.1;          // of the cord
  double thickness = 2.1;      // of the cord
  std::size_t plies = 3;
  double twists = 0.55;  // plies that pass per mm
  double ply_relief = 0.3;
  double fibre_relief = 0.06;
  double knot_size = 1.75;    // width of a knot, in widths of the cord
  double irregularity = 0.6;  // of the places of knots
  double sag = 0.5;           // of the cords, up, down and sideways
};

void describe(Fields& fields, Net& net);
void stretch(Net& net, double along_x, double along_y);
Surface make_surface(const Net& net, std::size_t columns, std::size_t rows);

}  // namespace weft
