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

}  // namespace weft
