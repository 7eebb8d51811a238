// General products of row-major matrices, singly or in batches, in either of two families of
// kernels.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// Which kernels compute a product. Both serve every device; results differ by rounding.
//   panels     packed panels and register micro-tiles, for CPU devices: gemm.cl, syrk.cl
//   tiles      tiles in local memory, for GPUs: gemm_tiled.cl
//   automatic  panels on CPU devices, tiles on others
enum class Family { automatic, panels, tiles };

enum class Transpose { no, yes };
enum class Triangle { lower, upper };

// Row-major matrices of a batch in a buffer: element (i, j) of matrix b at
// offset + b stride + i leading + j. A stride of 0 is one matrix for the whole batch.
template <typename BufferType>
struct BasicMatrix {
  BufferType& buffer;
  std::size_t leading;
  std::size_t offset = 0;
  std::size_t stride = 0;
};
using ConstMatrix = BasicMatrix<const Buffer>;
using Matrix = BasicMatrix<Buffer>;

struct ProductOptions {
  Arithmetic arithmetic = Arithmetic::f32;
  Family family = Family::automatic;
  std::size_t batch = 1;
};

// C = alpha op(A) op(B) + beta C with op(A): M x K, op(B): K x N; any size may be 0. C must not
// overlap A or B, nor the matrices of C each other. Where beta is 0, C is not read; where alpha is
// 0, A and B are not. NaN and infinities propagate. An input error names a matrix that its buffer
// does not hold.
//
// |error| <= gamma(product_terms(K)) (|alpha| |op(A)| |op(B)| + |beta C|), gamma(n) = n u / (1 - n
// u) with the unit roundoff u: sums are blocked, so that terms grow with 2 K / KC of gemm.cl, K /
// 192 by default.
void gemm(Device& device, Transpose a, Transpose b, std::size_t M, std::size_t N, std::size_t K,
          double alpha, const ConstMatrix& A, const ConstMatrix& B, double beta, const Matrix& C,
          const ProductOptions& options = {});

// C = alpha A A^T + beta C of A: n x K, or with Transpose::yes alpha A^T A + beta C of A: K x n.
// Only that triangle of C, with its diagonal, is read and written. Otherwise as gemm().
void syrk(Device& device, Triangle triangle, Transpose a, std::size_t n, std::size_t K,
          double alpha, const ConstMatrix& A, double beta, const Matrix& C,
          const ProductOptions& options = {});

// Most bytes that either holds in temporary buffers.
std::size_t product_bytes(const Device& device, std::size_t N, std::size_t K,
                          const ProductOptions& options = {});

// Roundings that a term of a sum over K can go through; see above.
std::size_t product_terms(const Device& device, std::size_t K, const ProductOptions& options = {});

}  // namespace weft::ops
