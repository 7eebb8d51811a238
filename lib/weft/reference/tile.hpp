// Tiles in double: the reference of the device's tile operations.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/metrics/log_errors.hpp"

namespace weft::reference {

// Raw values as double: 8-bit as x / 255; with `nan_zero`, NaN and infinities as 0.
void to_double(DType dtype, std::span<const std::byte> raw, bool nan_zero, std::span<double> out);

// The largest magnitude that encoders take: beyond, sums of values leave the range of float.
inline constexpr double largest_magnitude = 0x1p100;

// Images [first, first + count) of a source as [count][P][C], and releases them. Throws an input
// error that names view, light, texel and channel of the first value that is NaN or infinite
// (unless `nan_zero`) or beyond the largest magnitude.
void read_tile(TileSource& source, std::size_t first, std::size_t count, bool nan_zero,
               std::span<double> out);

// The input error of a value that is NaN or infinite; `at` is its index in [V, L, Y, X, C].
[[noreturn]] void fail_non_finite(const BtfShape& shape, std::size_t at);

// What a first look at [images][P][C] finds.
struct TileScan {
  std::vector<double> sums;              // [images][C], of the finite values
  double largest = 0;                    // largest finite magnitude
  std::optional<std::size_t> first_bad;  // index of the first NaN or infinity
};
TileScan scan_tile(std::size_t images, std::size_t texels, std::size_t channels,
                   std::span<const double> values);

// rows[image C + c][p] = (T[image, p, c] - mean[image C + c]) scale
std::vector<double> convert_tile(std::size_t images, std::size_t texels, std::size_t channels,
                                 std::span<const double> values, std::span<const double> mean,
                                 double scale);

// Errors of decoded values; a NaN in either makes the maximum NaN.
ErrorSums error_sums(std::span<const double> values, std::span<const double> decoded);
// The same on a logarithmic scale, see weft/metrics/log_errors.hpp.
LogErrorSums log_error_sums(std::span<const double> values, std::span<const double> decoded,
                            double scale);

// The value that the nearest one of type `dtype` is stored for, of a value in `from` turned into
// `to`: 8-bit in [0, 1] (NaN gives 0), finite values of F16 within +-65504.
double transcode(double value, Encoding from, Encoding to, DType dtype);

}  // namespace weft::reference
