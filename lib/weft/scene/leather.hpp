// Grained leather: a skin of irregular cells with grooves between them, fine wrinkles, creases and
// pores. Lengths in millimetres.
//
//   elevation = -grain_depth groove(border) + dome of each cell - crease - wrinkle - pore
//
// `border` is the distance to the edge of a cell of a Worley pattern, whose coordinates are bent by
// smooth noise, so that no edge is straight.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct Leather {
  std::array<double, 2> tile{24, 24};
  std::uint64_t seed = 1;
  std::array<float, 3> color{0.20f, 0.075f, 0.03f};          // diffuse albedo of the grain
  std::array<float, 3> groove_color{0.05f, 0.018f, 0.008f};  // and in the grooves
  GlossyLobe gloss{{0.045f, 0.045f, 0.045f}, 1, 0.26f, 0.26f};
  double groove_roughness = 0.6;  // the polish does not reach into grooves
  double color_spread = 0.12;     // relative
  double cell_size = 1.7;         // mean width of a cell
  double cell_jitter = 0.95;      // irregularity of the cells
  double groove_width = 0.16;
  double grain_depth = 0.14;
  double dome = 0.08;         // how much a cell bulges
  double wrinkle_size = 0.5;  // of the fine wrinkles
  double wrinkle_depth = 0.02;
  double crease_size = 9;  // of the long creases
  double crease_depth = 0.12;
  double pore_spacing = 1.1;
  double pore_width = 0.16;
  double pore_depth = 0.08;
};

void describe(Fields& fields, Leather& leather);
void stretch(Leather& leather, double along_x, double along_y);
Surface make_surface(const Leather& leather, std::size_t columns, std::size_t rows);

}  // namespace weft
