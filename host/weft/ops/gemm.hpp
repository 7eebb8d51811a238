// Matrix products on the device: kernels/gemm.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// A matrix in a buffer, addressed by strides in elements; see kernels/gemm.cl. Made by the
// functions below.
struct Operand {
  const Buffer* buffer = nullptr;
  std::size_t offset = 0;
  std::size_t row = 0;
  std::size_t column = 0;
  std::size_t panel = 0;
  Arithmetic arithmetic = Arithmetic::f32;
  enum class Layout { row_major, transposed, panelled } layout = Layout::row_major;
  std::size_t batch = 0;  // from one matrix of a batch to the next
};

// Row-major with a leading dimension; its transpose; panels of which each holds `rows` rows.
Operand row_major(const Device& device, const Buffer& buffer, std::size_t leading,
                  std::size_t offset = 0, Arithmetic arithmetic = Arithmetic::f32);
Operand transposed(const Device& device, const Buffer& buffer, std::size_t leading,
                   std::size_t offset = 0, Arithmetic arithmetic = Arithmetic::f32);
Operand panelled(const Device& device, const Buffer& buffer, std::size_t rows,
                 Arithmetic arithmetic = Arithmetic::f32);

// Where a product is written: C(i, j) at offset + i row + (j / NR) panel + j % NR.
struct Result {
  Buffer* buffer = nullptr;
  std::size_t offset = 0;
  std::size_t row = 0;
  std::size_t panel = 0;
  std::size_t batch = 0;
};
Result to_row_major(const Device& device, Buffer& buffer, std::size_t leading,
                    std::size_t offset = 0, Arithmetic arithmetic = Arithmetic::f32);
// Panels of which each holds `rows` rows; N is then taken as a whole number of panels.
Result to_panels(const Device& device, Buffer& buffer, std::size_t rows,
                 Arithmetic arithmetic = Arithmetic::f32);

// Elements of a K x N matrix packed in panels.
std::size_t packed_elements(const Device& device, std::size_t K, std::size_t N,
                            Arithmetic arithmetic = Arithmetic::f32);

// Roundings that a product can go through on its way into C, in blocks of the depth that the device
// is tuned to: |error| <= gamma(gemm_terms) (|alpha| |A| |B| + |beta C|), gamma(n) = n u / (1 - n
// u) with the unit roundoff u. It grows with K / depth.
std::size_t gemm_terms(const Device& device, std::size_t K);

// Packs a K x N matrix (row-major or transposed operand) into `packed`, in its own arithmetic;
// or the matrices of a batch, one after the other.
void pack_panels(Device& device, const Operand& B, std::size_t K, std::size_t N, Buffer& packed,
                 std::size_t batch = 1);

// A packed K x N matrix at an offset of a buffer; those of a batch lie one after the other, or the
// same one serves all.
struct Packed {
  const Buffer& buffer;
  std::size_t offset = 0;
  bool shared = false;

  Packed(const Buffer& panels, std::size_t first = 0, bool serves_all = false)
      : buffer(panels), offset(first), shared(serves_all) {}
};

// C = alpha A B + beta C with packed B, in the arithmetic of A, which is that of all. Where beta is
// 0, C is not read. K is at least 1.
void gemm_packed(Device& device, std::size_t M, std::size_t N, std::size_t K, double alpha,
                 const Operand& A, const Packed& B, double beta, const Result& C,
                 std::size_t batch = 1);

// The same with B as it is; packs it into a temporary buffer of at most gemm_bytes(), part by part.
void gemm(Device& device, std::size_t M, std::size_t N, std::size_t K, double alpha,
          const Operand& A, const Operand& B, double beta, const Result& C, std::size_t batch = 1);
std::size_t gemm_bytes(const Device& device, std::size_t N, std::size_t K,
                       Arithmetic arithmetic = Arithmetic::f32, std::size_t batch = 1);

// C = beta C of the M x N matrices of a batch; `triangle`: 1 only columns up to the row, 2 from it.
void scale_matrix(Device& device, std::size_t M, std::size_t N, double beta, const Result& C,
                  Arithmetic arithmetic, std::size_t batch = 1, unsigned triangle = 0);

}  // namespace weft::ops
