// Inner products in double on the device: kernels/gram.cl.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// n column vectors' worth of rows in panels of panel_width(device); rows are padded to a whole
// panel.
struct Columns {
  const Buffer* buffer = nullptr;
  std::size_t count = 0;  // columns
  std::size_t panel = 0;
  std::size_t row = 0;
  Arithmetic arithmetic = Arithmetic::f32;
  std::size_t offset = 0;  // elements before the first column
};

// Packed panels [ceil(count / NR)][n][NR]; a row-major n x leading matrix, leading >= count rounded
// up to NR.
Columns packed_columns(const Device& device, const Buffer& buffer, std::size_t n, std::size_t count,
                       Arithmetic arithmetic = Arithmetic::f32);
Columns row_major_columns(const Device& device, const Buffer& buffer, std::size_t leading,
                          std::size_t count, Arithmetic arithmetic = Arithmetic::f32);

// The arithmetic that products are summed in: double where the device has it, else pairs of floats;
// or pairs on any device.
enum class GramSums { best, float_pairs };

// Bytes of the partial sums that gram() holds on the device, and again on the host.
std::size_t gram_bytes(std::size_t n, std::size_t count_x, std::size_t count_z);

// G(i, j) = sum over p < n of X(p, i) Z(p, j), row-major count_x x count_z; waits for the device. X
// and Z are of one arithmetic; columns of doubles are summed in double.
// Sums are those of chunks of c = max(512, n / 64) rows. With double, |error| <= t 2^-53 sum |X Z|,
// t = 577 + c / 512 for n >= 512, since chunks are blocked as well. With pairs, |error| <= (2 c
// 2^-24)^2 sum |X Z| at worst, and columns may be of any magnitude.
std::vector<double> gram(Device& device, std::size_t n, const Columns& X, const Columns& Z,
                         GramSums sums = GramSums::best);

}  // namespace weft::ops
