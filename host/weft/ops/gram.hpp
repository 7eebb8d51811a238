// Inner products in double on the device: kernels/gram.cl.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"

namespace weft::ops {

// n column vectors' worth of rows in panels of panel_width(device); rows are padded to a whole
// panel.
struct Columns {
  const Buffer* buffer = nullptr;
  std::size_t count = 0;  // columns
  std::size_t panel = 0;
  std::size_t row = 0;
};

// Packed panels [ceil(count / NR)][n][NR]; a row-major n x leading matrix, leading >= count rounded
// up to NR.
Columns packed_columns(const Device& device, const Buffer& buffer, std::size_t n,
                       std::size_t count);
Columns row_major_columns(const Device& device, const Buffer& buffer, std::size_t leading,
                          std::size_t count);

// G(i, j) = sum over p < n of X(p, i) Z(p, j), row-major count_x x count_z. Sums are exact to about
// 2^-44 of sum |X Z| or better: products in double, or in float pairs where the device has no fp64.
// Waits for the device.
std::vector<double> gram(Device& device, std::size_t n, const Columns& X, const Columns& Z);

}  // namespace weft::ops
