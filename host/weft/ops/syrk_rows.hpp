// Products of a few long rows with their own transpose: kernels/syrk_rows.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/syrk.hpp"

namespace weft::ops {

// Rows beyond which packed panels are as fast.
inline constexpr std::size_t most_long_rows = 512;

// Row i begins at offset + i leading. Its values are neighbours, or parts of `inner` neighbours
// that lie `batch` apart: the mode-n unfolding of a tensor [outer][m][inner] has K = outer inner,
// leading = inner and batch = m inner.
struct LongRows {
  const Buffer* buffer = nullptr;
  std::size_t offset = 0;
  std::size_t leading = 0;
  std::size_t inner = 0;  // 0: K
  std::size_t batch = 0;
  // Values in another arithmetic than the product's: floats, for sums in double.
  bool floats = false;
};

// C = alpha X X^T + beta C of an m x K matrix X, m at most `most_long_rows`, K at least 1; C(i, j),
// j <= i (Written::lower) or j >= i (Written::upper), is read and written. Where beta is 0, C is
// not read.
//
// |error(i, j)| <= gamma(syrk_rows_terms(m, K)) (|alpha| sum |X(i, k) X(j, k)| + |beta C(i, j)|).
void syrk_rows(Device& device, std::size_t m, std::size_t K, double alpha, const LongRows& X,
               double beta, const Result& C, Written written, Arithmetic arithmetic);

// The same with scratch memory of the caller's, of at least syrk_rows_bytes; does not wait for the
// device.
struct RowScratch {
  Buffer copy;
  Buffer partial;
};
RowScratch row_scratch(Device& device, std::size_t m, std::size_t K, Arithmetic arithmetic);
void syrk_rows(Device& device, std::size_t m, std::size_t K, double alpha, const LongRows& X,
               double beta, const Result& C, Written written, Arithmetic arithmetic,
               RowScratch& scratch);

// Bytes that it holds on the device.
std::size_t syrk_rows_bytes(std::size_t m, std::size_t K, Arithmetic arithmetic);

// Roundings that a product can go through on its way into C.
std::size_t syrk_rows_terms(std::size_t m, std::size_t K, Arithmetic arithmetic);

}  // namespace weft::ops
