// Seeded numbers, the same on every machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace weft::reference {

// The i-th output of SplitMix64 from `seed` (Steele, Lea & Flood 2014): a hash of (seed, i).
std::uint64_t splitmix64(std::uint64_t seed, std::uint64_t index);

// Fills with values uniform in [-1, 1); value i depends on seed and i alone.
void fill_random(std::uint64_t seed, std::span<float> values);

}  // namespace weft::reference
