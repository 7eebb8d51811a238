// Hammered sheet metal: overlapping dents of a round hammer, each a shallow bowl that cuts into its
// neighbours, so that ridges stand between them. Lengths in millimetres.
//
//   elevation = softmin_i ( |p - c_i|^2 / (2 R) - d_i ) + waviness
//
// c_i are scattered points, R the radius of the hammer's face and d_i the depth of the strike; the
// soft minimum rounds the ridges. Ridges are polished by use, hollows keep a tarnish.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct HammeredMetal {
  std::array<double, 2> tile{60, 60};
  std::uint64_t seed = 1;
  std::array<float, 3> color{0.02f, 0.012f, 0.008f};  // diffuse albedo of bare metal
  GlossyLobe gloss{{0.93f, 0.60f, 0.43f}, 1, 0.16f, 0.16f};
  std::array<float, 3> tarnish_color{0.07f, 0.035f, 0.02f};  // diffuse albedo of tarnish
  double tarnish_roughness = 0.38;
  double tarnish = 0.45;       // share of the surface that is tarnished
  double dent_size = 7.5;      // distance between strikes
  double hammer_radius = 16;   // of the hammer's face
  double depth_spread = 0.16;  // standard variation of the depth of a strike
  double ridge_width = 0.35;   // over which ridges are rounded
  double waviness = 0.25;      // of the sheet as a whole
  double pitting = 0.006;      // depth of the hammer's own roughness
};

void describe(Fields& fields, HammeredMetal& metal);
void stretch(HammeredMetal& metal, double along_x, double along_y);
Surface make_surface(const HammeredMetal& metal, std::size_t columns, std::size_t rows);

}  // namespace weft
