// Corduroy: ribs of cut pile, the wales, along y, on a woven ground that shows in the furrows.
// Lengths in millimetres.
//
//   elevation = pile_height (1 - |u|^shape) (1 - tufts) + nap,   u = offset / (wale_width / 2)
//
//     .-~~-.    .-~~-.    .-~~-.      wales of pile
//    / |||| \  / |||| \  / |||| \     their fibres lean outwards and along the nap
//   _________--________--________     ground
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct Corduroy {
  std::size_t wales = 8;  // of one tile
  double length = 20;     // of the tile along the wales
  std::uint64_t seed = 1;
  std::array<float, 3> color{0.23f, 0.12f, 0.035f};          // diffuse albedo of the tips
  std::array<float, 3> root_color{0.06f, 0.028f, 0.009f};    // and deep in the pile
  std::array<float, 3> ground_color{0.07f, 0.035f, 0.012f};  // of the ground in the furrows
  GlossyLobe gloss{{0.03f, 0.027f, 0.022f}, 0.9f, 0.65f, 0.42f};
  double color_spread = 0.12;  // relative
  double wale_pitch = 2.5;     // distance of wales
  double wale_width = 2.1;     // of the pile
  double pile_height = 1.0;
  double shape = 2.4;        // exponent of the section: 2 a parabola, larger is boxier
  double wander = 0.07;      // of the wales, sideways
  double tuft_length = 0.5;  // distance of tufts along a wale
  double tuft_depth = 0.12;  // of the gaps between tufts
  double nap = 0.07;         // roughness of the cut ends
  double lean = 0.5;         // of the fibres along the wale, relative to how they fan out
};

void describe(Fields& fields, Corduroy& corduroy);
void stretch(Corduroy& corduroy, double along_x, double along_y);
Surface make_surface(const Corduroy& corduroy, std::size_t columns, std::size_t rows);

}  // namespace weft
