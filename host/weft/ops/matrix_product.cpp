#include "weft/ops/matrix_product.hpp"

#include <algorithm>
#include <limits>

#include "weft/error.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gemm_tiled.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/syrk.hpp"
#include "weft/ops/syrk_rows.hpp"

namespace weft::ops {
namespace {
// Packed rows of a long matrix at a time: they stay in the caches.
constexpr std::size_t most_packed_bytes = std::size_t{8} << 20;

bool in_tiles(const Device& device, Family family) {
  return family == Family::tiles || (family == Family::automatic && !device.limits().is_cpu);
}

// Throws unless the buffer holds `batch` matrices of rows x columns.
void check_matrix(const char* name, std::size_t bytes, std::size_t leading, std::size_t offset,
                  std::size_t stride, std::size_t rows, std::size_t columns,
                  const ProductOptions& options) {
  if (rows == 0 || columns == 0 || options.batch == 0) return;
  if (leading < columns) {
    fail_input("matrix {}: a leading dimension of {} is less than its {} columns", name, leading,
               columns);
  }
  const std::size_t elements = bytes / size_of(options.arithmetic);
  std::size_t last = columns;
  const auto add = [&](std::size_t count, std::size_t step) {
    if (__builtin_mul_overflow(count, step, &step) || __builtin_add_overflow(last, step, &last)) {
      last = std::numeric_limits<std::size_t>::max();
    }
  };
  add(1, offset);
  add(options.batch - 1, stride);
  add(rows - 1, leading);
  if (last > elements) {
    fail_input(
        "matrix {}: {} x {} with leading dimension {}, offset {} and {} in a batch does not fit "
        "a buffer of {} values",
        name, rows, columns, leading, offset, options.batch, elements);
  }
}

template <typename BufferType>
void check_matrix(const char* name, const BasicMatrix<BufferType>& X, bool transposed,
                  std::size_t rows, std::size_t columns, const ProductOptions& options) {
  if (transposed) std::swap(rows, columns);
  check_matrix(name, X.buffer.size(), X.leading, X.offset, X.stride, rows, columns, options);
}

Operand operand(const Device& device, const ConstMatrix& X, bool transpose, Arithmetic arithmetic) {
  Operand result = transpose ? transposed(device, X.buffer, X.leading, X.offset, arithmetic)
                             : row_major(device, X.buffer, X.leading, X.offset, arithmetic);
  result.batch = X.stride;
  return result;
}

Result result_of(const Device& device, const Matrix& C, Arithmetic arithmetic) {
  Result result = to_row_major(device, C.buffer, C.leading, C.offset, arithmetic);
  result.batch = C.stride;
  return result;
}

// Rows of X that a product X^T X takes at a time; a function of the shape alone.
std::size_t rows_at_once(const Device& device, std::size_t n, std::size_t K,
                         Arithmetic arithmetic) {
  const std::size_t row_bytes = packed_elements(device, 1, n, arithmetic) * size_of(arithmetic);
  const std::size_t granule = 3840;  // whole blocks
  return std::min(K, std::max<std::size_t>(1, most_packed_bytes / row_bytes / granule) * granule);
}

// Whether X X^T of n rows of K neighbours each is a sum over few long rows.
bool has_long_rows(std::size_t n, std::size_t K, bool transposed) {
  return !transposed && n <= most_long_rows && K >= 16 * n;
}

// C = alpha X^T X + beta C, X packed part by part.
void syrk_panels(Device& device, Triangle triangle, std::size_t n, std::size_t K, double alpha,
                 const Operand& X, double beta, const Result& C, const ProductOptions& options) {
  const std::size_t rows = rows_at_once(device, n, K, options.arithmetic);
  Buffer packed(device,
                packed_elements(device, rows, n, options.arithmetic) * size_of(options.arithmetic),
                "packed matrix");
  const Written written = triangle == Triangle::lower ? Written::lower : Written::upper;
  for (std::size_t b = 0; b < options.batch; ++b) {
    Result c = C;
    c.offset += b * C.batch;
    for (std::size_t k = 0; k < K; k += rows) {
      const std::size_t count = std::min(rows, K - k);
      Operand x = X;
      x.offset += b * X.batch + k * X.row;
      pack_panels(device, x, count, n, packed);
      syrk_packed(device, n, count, alpha, packed, k == 0 ? beta : 1.0, c, written,
                  options.arithmetic);
    }
  }
}

}  // namespace

void gemm(Device& device, Transpose a, Transpose b, std::size_t M, std::size_t N, std::size_t K,
          double alpha, const ConstMatrix& A, const ConstMatrix& B, double beta, const Matrix& C,
          const ProductOptions& options) {
  const bool a_transposed = a == Transpose::yes;
  const bool b_transposed = b == Transpose::yes;
  require_arithmetic(device, options.arithmetic);
  check_matrix("A", A, a_transposed, M, K, options);
  check_matrix("B", B, b_transposed, K, N, options);
  check_matrix("C", C, false, M, N, options);
  if (M == 0 || N == 0 || options.batch == 0) return;
  const Result result = result_of(device, C, options.arithmetic);
  if (K == 0 || alpha == 0) {
    if (beta != 1) scale_matrix(device, M, N, beta, result, options.arithmetic, options.batch);
    return;
  }
  if (in_tiles(device, options.family)) {
    gemm_tiled(device, {M, N, K, a_transposed, b_transposed, 0}, alpha, A, B, beta, C, options);
    return;
  }
  gemm(device, M, N, K, alpha, operand(device, A, a_transposed, options.arithmetic),
       operand(device, B, b_transposed, options.arithmetic), beta, result, options.batch);
}

void syrk(Device& device, Triangle triangle, Transpose a, std::size_t n, std::size_t K,
          double alpha, const ConstMatrix& A, double beta, const Matrix& C,
          const ProductOptions& options) {
  const bool transposed = a == Transpose::yes;
  const unsigned part = triangle == Triangle::lower ? 1 : 2;
  require_arithmetic(device, options.arithmetic);
  check_matrix("A", A, transposed, n, K, options);
  check_matrix("C", C, false, n, n, options);
  if (n == 0 || options.batch == 0) return;
  const Result result = result_of(device, C, options.arithmetic);
  if (K == 0 || alpha == 0) {
    if (beta != 1)
      scale_matrix(device, n, n, beta, result, options.arithmetic, options.batch, part);
    return;
  }
  if (in_tiles(device, options.family)) {
    gemm_tiled(device, {n, n, K, transposed, !transposed, part}, alpha, A, A, beta, C, options);
    return;
  }
  if (has_long_rows(n, K, transposed)) {
    for (std::size_t b = 0; b < options.batch; ++b) {
      Result c = result;
      c.offset += b * C.stride;
      syrk_rows(device, n, K, alpha, {&A.buffer, A.offset + b * A.stride, A.leading}, beta, c,
                triangle == Triangle::lower ? Written::lower : Written::upper, options.arithmetic);
    }
    return;
  }
  syrk_panels(device, triangle, n, K, alpha, operand(device, A, !transposed, options.arithmetic),
              beta, result, options);
}

std::size_t product_bytes(const Device& device, std::size_t N, std::size_t K,
                          const ProductOptions& options) {
  if (N == 0 || K == 0 || options.batch == 0 || in_tiles(device, options.family)) return 0;
  const std::size_t rows = rows_at_once(device, N, K, options.arithmetic);
  std::size_t syrk =
      packed_elements(device, rows, N, options.arithmetic) * size_of(options.arithmetic) +
      syrk_bytes(device, N, rows, options.arithmetic);
  if (has_long_rows(N, K, false)) {
    syrk = std::max(syrk, syrk_rows_bytes(N, K, options.arithmetic));
  }
  return std::max(syrk, gemm_bytes(device, N, K, options.arithmetic, options.batch));
}

std::size_t product_terms(const Device& device, std::size_t K, const ProductOptions& options) {
  if (in_tiles(device, options.family)) return gemm_tiled_terms(K);
  // gemm: blocks of its own depth; syrk: parts of at least 3840 rows, each of blocks in slices, or
  // fewer (syrk_rows)
  const std::size_t parts = ceil_div(K, 3840);
  const std::size_t in_part = 480 + 2 * ceil_div(3840, 240) + 35;
  return std::max(gemm_terms(device, K), std::min(K, in_part) + 2 * parts + 3);
}

}  // namespace weft::ops
