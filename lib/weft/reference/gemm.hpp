// General matrix product in double: the reference of kernels/gemm.cl.
#pragma once

#include <cstddef>
#include <span>

namespace weft::reference {

// C = alpha A B + beta C of row-major A (M x K), B (K x N) and C (M x N). Where beta is 0, C is not
// read.
void gemm(std::size_t M, std::size_t N, std::size_t K, double alpha, std::span<const double> A,
          std::span<const double> B, double beta, std::span<double> C);

}  // namespace weft::reference
