// Operations on raw tiles: scan_tile.cl, convert_tile.cl, error_sums.cl, weighted_squares.cl,
// transcode_tile.cl.
//
// A raw tile is [images][P][C] of U8, F16 or F32 in a device buffer; 8-bit values count as x / 255.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/device/device.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

struct TileShape {
  std::size_t images = 0;
  std::size_t texels = 0;    // P
  std::size_t channels = 0;  // C
  DType dtype = DType::f32;
  bool nan_zero = false;  // read NaN and infinities as 0

  std::size_t rows() const { return images * channels; }
  std::size_t values() const { return rows() * texels; }
};

struct TileScan {
  std::vector<double> sums;              // [images][C], of the finite values
  float largest = 0;                     // largest finite magnitude
  std::optional<std::size_t> first_bad;  // index into the tile of the first NaN or infinity
};

// Sums, range and the first non-finite value. Waits for the device.
TileScan scan_tile(Device& device, const TileShape& tile, const Buffer& raw);

// Elements of a tile's panels: [ceil(P / NR)][images C][NR].
std::size_t panel_elements(const Device& device, const TileShape& tile,
                           Arithmetic arithmetic = Arithmetic::f32);

// panels(row, p) = (T - mean[first_row + row]) scale, in the given arithmetic; means are floats.
// `scale` must be a power of two. With `squares`, waits and adds the sum of the squared results to
// it.
void convert_tile(Device& device, const TileShape& tile, const Buffer& raw, const Buffer& mean,
                  std::size_t first_row, float scale, Buffer& panels, double* squares = nullptr,
                  Arithmetic arithmetic = Arithmetic::f32);

// The same transposed: panels(p, row), columns of which are the tile's rows.
// Elements of [ceil(images C / NR)][P][NR].
std::size_t transposed_panel_elements(const Device& device, const TileShape& tile,
                                      Arithmetic arithmetic = Arithmetic::f32);
void convert_tile_transposed(Device& device, const TileShape& tile, const Buffer& raw,
                             const Buffer& mean, std::size_t first_row, float scale, Buffer& panels,
                             Arithmetic arithmetic = Arithmetic::f32);

// Errors of a decoded tile (float, [images][P][C]) against the raw one. `scale`: a power of two
// that brings values near 1. Waits for the device.
ErrorSums error_sums(Device& device, const TileShape& tile, const Buffer& raw,
                     const Buffer& decoded, float scale);

// Sums of squares with weights of the texels, of one image.
struct WeightedSquares {
  double reference = 0;   // sum w_p T^2
  double difference = 0;  // sum w_p (T - T')^2
};

// The same of each image of a tile; `weights` are floats [P][C]. Waits for the device.
std::vector<WeightedSquares> weighted_squares(Device& device, const TileShape& tile,
                                              const Buffer& raw, const Buffer& decoded,
                                              const Buffer& weights, float scale);

// Converts `count` floats in `in` from one encoding to another and stores them as `dtype`: U8
// clamps to [0, 1] and rounds; F16 clamps finite values to +-65504.
void transcode_tile(Device& device, std::size_t count, const Buffer& in, Encoding from, Encoding to,
                    DType dtype, Buffer& out);

}  // namespace weft::ops
