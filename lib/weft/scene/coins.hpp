// A heap of struck coins on felt, each resting on those below it as its weight tips it. Lengths in
// millimetres.
//
// A coin falls flat; among all planes that touch nothing below, it takes the one with the lowest
// middle, which is where a heavy disc comes to rest on three points. The topmost coins are sheets
// with undersides, so that light reaches beneath their raised edges; the others are solid.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct CoinKind {
  double share = 1;  // of all coins, relative to the other kinds
  double diameter = 22;
  double thickness = 2;
  double relief = 0.35;                                    // height of rim and design
  std::array<float, 3> color{0.03f, 0.022f, 0.014f};       // diffuse albedo of the metal
  std::array<float, 3> dirt_color{0.03f, 0.022f, 0.015f};  // of what sticks in corners
  GlossyLobe gloss{{0.78f, 0.62f, 0.36f}, 1, 0.28f, 0.28f};
  double wear = 0.5;  // 0 freshly struck, 1 worn smooth and dirty
};

struct Coins {
  std::array<double, 2> tile{75, 75};
  std::uint64_t seed = 1;
  double cover = 2;  // area of all coins together, in tiles
  std::array<float, 3> felt_color{0.015f, 0.05f, 0.03f};
  std::vector<CoinKind> coins = std::vector<CoinKind>(1);
};

// Most layers of its surface: the felt with the buried coins, and sheets of topmost ones.
inline constexpr std::size_t coin_layers = 3;

void describe(Fields& fields, CoinKind& kind);
void describe(Fields& fields, Coins& coins);
void stretch(Coins& coins, double along_x, double along_y);
Surface make_surface(const Coins& coins, std::size_t columns, std::size_t rows);

}  // namespace weft
