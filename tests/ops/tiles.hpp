// Raw tiles on the host for tests of tile operations.
#pragma once

#include <cstddef>
#include <cstdint>
#include <ostream>
#include <span>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/tile.hpp"

namespace weft::test {

inline constexpr DType raw_types[] = {DType::u8, DType::f16, DType::f32};

struct Tile {
  ops::TileShape shape;
  std::vector<std::byte> raw;
  std::vector<double> values;  // what `raw` stands for, exactly
};

inline std::ostream& operator<<(std::ostream& out, const Tile& tile) {
  return out << tile.shape.images << " images of " << tile.shape.texels << " texels, "
             << tile.shape.channels << " channels, " << name_of(tile.shape.dtype);
}

inline Tile tile_of(std::size_t images, std::size_t texels, std::size_t channels, DType dtype,
                    std::span<const double> values) {
  Tile tile{{images, texels, channels, dtype, false}, encode_values(values, dtype), {}};
  tile.values = decode_values(tile.raw, dtype);
  return tile;
}

// Values in [-2, 2), 8-bit ones in [0, 1].
inline Tile random_tile(std::size_t images, std::size_t texels, std::size_t channels, DType dtype,
                        std::uint64_t seed) {
  const bool bytes = dtype == DType::u8;
  return tile_of(
      images, texels, channels, dtype,
      random_values(images * texels * channels, seed, bytes ? 0.0 : -2.0, bytes ? 1.0 : 2.0));
}

inline GuardedBuffer guarded_raw(const Tile& tile) {
  return {shared_device(), std::span<const std::byte>(tile.raw), "raw tile"};
}

}  // namespace weft::test
