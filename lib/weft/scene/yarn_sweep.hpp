// Yarns as tubes along curves, drawn into a layer of a surface.
//
//   top(p) = z(s) + h,  bottom(p) = z(s) - h,   h = thickness/2 sqrt(1 - u^2) + ply relief
//
// s is the place of the curve nearest to p, seen from above, and u the offset there over half the
// width. Beyond the edge, |u| > 1, both go on past each other, so that the outline between two
// samples runs where they cross. Where two tubes meet in a layer the higher one is shown, and they
// are solid from the higher top to the lower bottom.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "weft/scene/surface.hpp"

namespace weft {

// How a yarn looks, whatever its path.
struct SweptYarn {
  std::array<float, 3> color{0.5f, 0.5f, 0.5f};
  double width = 0.5, thickness = 0.45;
  std::size_t plies = 3;
  double twists = 1;  // plies that pass per length
  double ply_relief = 0.04;
  double fibre_relief = 0.01;
  double color_spread = 0.1;
  std::size_t lobe = 0;
  std::uint64_t key = 0;  // of its irregularities
};

// A curve over the tile, joined by lines. A closed one leads from its last point to the first one
// shifted by `closing`, whole tiles.
struct YarnCurve {
  std::vector<std::array<double, 3>> points;  // x, y, z
  std::vector<double> girth;  // factor on width and thickness at each point; empty: 1 everywhere
  bool closed = true;
  std::array<double, 2> closing{0, 0};
};

// Gives all layers undersides, and nothing in them.
void clear_layers(Surface& surface);

void sweep_yarn(Surface& surface, std::size_t layer, const SweptYarn& yarn, const YarnCurve& curve);

}  // namespace weft
