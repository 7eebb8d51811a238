// Tiles in double: the reference of the device's tile operations.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"
#include "weft/metrics/error_sums.hpp"

namespace weft::reference {

// Raw values as double: 8-bit as x / 255; with `nan_zero`, NaN and infinities as 0.
void to_double(DType dtype, std::span<const std::byte> raw, bool nan_zero, std::span<double> out);

// Images [first, first + count) of a source as [count][P][C], and releases them. Throws an input
// error that names view, light, texel and channel of the first NaN or infinity, unless `nan_zero`.
void read_tile(TileSource& source, std::size_t first, std::size_t count, bool nan_zero,
               std::span<double> out);

// The input error of a value that is NaN or infinite; `at` is its index in [V, L, Y, X, C].
[[noreturn]] void fail_non_finite(const BtfShape& shape, std::size_t at);

// Sums over [images][P][C] per image and channel.
std::vector<double> tile_sums(std::size_t images, std::size_t texels, std::size_t channels,
                              std::span<const double> values);

ErrorSums error_sums(std::span<const double> values, std::span<const double> decoded);

}  // namespace weft::reference
