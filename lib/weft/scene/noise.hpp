// Hashed value noise that repeats: the irregularities of simulated materials.
#pragma once

#include <cstdint>

namespace weft {

// A well mixed 64-bit value of a 64-bit value (the finaliser of SplitMix64).
std::uint64_t hash(std::uint64_t value);

// A number in [0, 1) for a key.
double hash_unit(std::uint64_t key);

// Smooth value noise in [-1, 1] over a lattice of unit cells that repeats after `period` (at least
// 1) cells.
double value_noise(double x, std::int64_t period, std::uint64_t key);
double value_noise(double x, double y, std::int64_t period_x, std::int64_t period_y,
                   std::uint64_t key);

// Smooth gradient noise (Perlin 2002, with hashed directions), nearly in [-1, 1] and 0 at the
// lattice points: no blocks are seen in its slopes. Repeats likewise.
double gradient_noise(double x, double y, std::int64_t period_x, std::int64_t period_y,
                      std::uint64_t key);

// A sum of gradient noises, each of twice the frequency and half the height of the one before it.
double fractal_noise(double x, double y, std::int64_t period_x, std::int64_t period_y, int octaves,
                     std::uint64_t key);

// Cells round scattered points (Worley 1996): one point in every unit square, displaced by up to
// `jitter` / 2 from its middle. Repeats likewise; periods of 1 and 2 are served as well.
struct Cell {
  std::uint64_t id = 0;               // a hash of the nearest point
  double nearest = 0, second = 0;     // distances to the two nearest points
  double border = 0;                  // distance to the bisector of the two
  double offset_x = 0, offset_y = 0;  // from the nearest point
};
Cell cell_at(double x, double y, std::int64_t period_x, std::int64_t period_y, double jitter,
             std::uint64_t key);

}  // namespace weft
