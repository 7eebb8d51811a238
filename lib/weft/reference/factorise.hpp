// Dense factorisations in double by Eigen, compiled once. Matrices are row-major spans.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft::reference {

// A = V diag(values) V^T of a symmetric n x n matrix (the lower triangle is read); values descend,
// column j of the row-major `vectors` is the j-th eigenvector.
struct SymmetricEigen {
  std::vector<double> values;   // n
  std::vector<double> vectors;  // n x n
};
SymmetricEigen symmetric_eigen(std::size_t n, std::span<const double> A);

// Thin SVD A = U diag(values) V^T of a rows x columns matrix, r = min(rows, columns), values
// descend. By divide and conquer, and where that fails, which is checked, by Jacobi rotations.
struct ThinSvd {
  std::vector<double> U;       // rows x r
  std::vector<double> values;  // r
  std::vector<double> V;       // columns x r
};
ThinSvd thin_svd(std::size_t rows, std::size_t columns, std::span<const double> A);

// Orthonormal basis of the column space of a rows x columns matrix (rows x rank), by column-pivoted
// Householder QR; columns below `tolerance` times the largest pivot are dropped.
struct Orthonormal {
  std::size_t rank = 0;
  std::vector<double> Q;  // rows x rank
};
Orthonormal orthonormal_basis(std::size_t rows, std::size_t columns, std::span<const double> A,
                              double tolerance);

// The inverse of a regular n x n matrix, by LU with partial pivoting.
std::vector<double> inverse(std::size_t n, std::span<const double> A);

}  // namespace weft::reference
