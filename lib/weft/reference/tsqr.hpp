// Triangular factor of a matrix in double: the reference of kernels/tsqr.cl.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft::reference {

// R of X = Q R, m x m, row-major, zero below the diagonal, of a row-major K x m matrix, by
// Householder QR; with fewer rows than columns, the rows of R past the K-th are zero.
std::vector<double> triangular_factor(std::size_t K, std::size_t m, std::span<const double> X);

// The same by blocks of rows, each stacked below the R of those before it.
std::vector<double> tsqr(std::size_t K, std::size_t m, std::span<const double> X,
                         std::size_t block_rows);

}  // namespace weft::reference
