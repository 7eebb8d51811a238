#include "weft/reference/gemm.hpp"

#include <vector>

namespace weft::reference {

void gemm(std::size_t M, std::size_t N, std::size_t K, double alpha, std::span<const double> A,
          std::span<const double> B, double beta, std::span<double> C) {
  std::vector<double> row(N);
  for (std::size_t i = 0; i < M; ++i) {
    row.assign(N, 0.0);
    for (std::size_t k = 0; k < K; ++k) {
      for (std::size_t j = 0; j < N; ++j) row[j] += A[i * K + k] * B[k * N + j];
    }
    for (std::size_t j = 0; j < N; ++j) {
      double& c = C[i * N + j];
      c = beta == 0.0 ? alpha * row[j] : alpha * row[j] + beta * c;
    }
  }
}

}  // namespace weft::reference
