#include "weft/reference/random.hpp"

namespace weft::reference {

std::uint64_t splitmix64(std::uint64_t seed, std::uint64_t index) {
  std::uint64_t z = seed + (index + 1) * 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

void fill_random(std::uint64_t seed, std::span<float> values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    // 24 bits: every value is exact in float
    const auto bits = static_cast<std::int32_t>(splitmix64(seed, i) >> 40);
    values[i] = static_cast<float>(bits - (1 << 23)) * 0x1p-23f;
  }
}

}  // namespace weft::reference
