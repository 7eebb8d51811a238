// Gravel: stones of several kinds and sizes, dropped one by one on a bed of sand until it is
// covered. Lengths in millimetres.
//
// A stone is a superellipsoid, lumpy, and cut by planes as far as it is angular:
//
//   top(p) = z + c min( (1 - q^e)^(1/e), planes ),   q = |(p'_x / a, p'_y / b)| at most 1
//
// p' is p in the stone's frame. Each stone falls where, of several places, it comes to rest lowest.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct StoneKind {
  double share = 1;  // of all stones, relative to the other kinds
  std::array<float, 3> color{0.3f, 0.28f, 0.26f};
  std::array<float, 3> grain_color{0.12f, 0.11f, 0.1f};  // of the grains in it
  double grain_size = 0.8;
  double grain_share = 0.3;    // of the grains in the stone
  double veins = 0;            // share of stones with a vein of the grains' colour
  double color_spread = 0.15;  // from stone to stone
  GlossyLobe gloss{{0.04f, 0.04f, 0.04f}, 1, 0.5f, 0.5f};
  double angularity = 0.3;  // 0 a pebble, 1 crushed rock
  double flatness = 0.65;   // height over width
  double roughness = 0.05;  // height of lumps, relative to the stone's size
};

struct Gravel {
  std::array<double, 2> tile{80, 80};
  std::uint64_t seed = 1;
  double least_size = 4;  // width of the smallest stones
  double most_size = 16;  // and of the largest
  double fineness = 1.6;  // exponent of the sizes: larger has fewer large stones
  double cover = 2.2;     // area of all stones together, in tiles
  std::array<float, 3> sand_color{0.16f, 0.12f, 0.085f};
  std::vector<StoneKind> stones = std::vector<StoneKind>(1);
};

void describe(Fields& fields, StoneKind& kind);
void describe(Fields& fields, Gravel& gravel);
void stretch(Gravel& gravel, double along_x, double along_y);
Surface make_surface(const Gravel& gravel, std::size_t columns, std::size_t rows);

}  // namespace weft
