#include "cases.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "weft/reference/random.hpp"

namespace weft::peers {
namespace {

Case gemm(std::size_t M, std::size_t N, std::size_t K, bool fp64 = false) {
  const char* kind = fp64 ? "dgemm" : "sgemm";
  const bool cube = M == N && N == K;
  return {cube ? fmt::format("{} {}", kind, M) : fmt::format("{} {}x{}x{}", kind, M, N, K),
          Operation::gemm,
          M,
          N,
          K,
          0,
          fp64};
}

Case syrk(std::size_t M, std::size_t K, std::size_t chunk, bool fp64 = false) {
  const char* kind = fp64 ? "dsyrk" : "ssyrk";
  return {M == K ? fmt::format("{} {}", kind, M) : fmt::format("{} {}x{}", kind, M, K),
          Operation::syrk,
          M,
          M,
          K,
          chunk,
          fp64};
}

// Euclidean lengths of the rows, or of the columns, of a row-major matrix.
template <typename T>
std::vector<double> lengths(const std::vector<T>& values, std::size_t rows, std::size_t columns,
                            bool of_rows) {
  std::vector<double> squares(of_rows ? rows : columns, 0.0);
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      const auto value = static_cast<double>(values[i * columns + j]);
      squares[of_rows ? i : j] += value * value;
    }
  }
  for (double& value : squares) value = std::sqrt(value);
  return squares;
}

std::vector<double> a_lengths(const Case& c, const Matrices& matrices) {
  std::vector<double> rows = c.fp64 ? lengths(matrices.A64, c.M, c.columns(), true)
                                    : lengths(matrices.A, c.M, c.columns(), true);
  for (double& value : rows) value *= std::sqrt(static_cast<double>(c.chunks()));
  return rows;
}

std::vector<double> b_lengths(const Case& c, const Matrices& matrices) {
  return c.fp64 ? lengths(matrices.B64, c.K, c.N, false) : lengths(matrices.B, c.K, c.N, false);
}

}  // namespace

double Case::flops() const {
  const auto m = static_cast<double>(M), n = static_cast<double>(N), k = static_cast<double>(K);
  return operation == Operation::gemm ? 2 * m * n * k : m * (m + 1) * k;
}

std::string Case::shape() const {
  if (operation == Operation::gemm) return fmt::format("{} x {} x {}", M, N, K);
  if (chunks() == 1) return fmt::format("{} x {}", M, K);
  return fmt::format("{} x {}, {} columns at a time", M, K, chunk);
}

std::vector<Case> all_cases() {
  return {
      gemm(2048, 2048, 2048),       gemm(4096, 4096, 4096),       gemm(2001, 2001, 2001),
      gemm(4099, 4099, 4099),       gemm(100000, 256, 300),       gemm(100000, 300, 64),
      gemm(2048, 2048, 2048, true), gemm(2001, 2001, 2001, true), syrk(2048, 2048, 2048),
      syrk(2048, 65536, 8192),      syrk(81, 4000000, 250000),    syrk(128, 2500000, 250000),
      syrk(243, 1300000, 130000),   syrk(2048, 2048, 2048, true),
  };
}

Matrices::Matrices(const Case& c)
    : A(c.M * c.columns()), B(c.operation == Operation::gemm ? c.K * c.N : 0) {
  reference::fill_random(1, A);
  reference::fill_random(2, B);
  if (!c.fp64) return;
  A64.assign(A.begin(), A.end());
  B64.assign(B.begin(), B.end());
}

double disagreement(const Case& c, const Matrices& matrices, const Elements& x, const Elements& y) {
  const bool triangle = c.operation == Operation::syrk;
  const std::vector<double> a = a_lengths(c, matrices);
  const std::vector<double> b = triangle ? a : b_lengths(c, matrices);
  const double unit = c.fp64 ? 0x1p-53 : 0x1p-24;
  const double terms = static_cast<double>(c.K) * unit;
  const double gamma = terms / (1 - terms);
  double largest = 0;
  std::size_t at = 0;
  for (std::size_t i = 0; i < c.M; ++i) {
    const std::size_t end = triangle ? i + 1 : c.N;
    for (std::size_t j = 0; j < end; ++j, ++at) {
      const double distance = std::abs(x[at] - y[at]) / (2 * gamma * a[i] * b[j]);
      if (!(distance <= largest)) largest = distance;  // keeps NaN
      if (std::isnan(largest)) return largest;
    }
  }
  return largest;
}

}  // namespace weft::peers
