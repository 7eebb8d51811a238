// Singular values and right singular vectors in long double: eleven bits better than the best
// arithmetic that is measured.
#pragma once

#include <vector>

#include "numerics/matrices.hpp"

namespace weft::numerics {

// Of 2^exponent X, whose largest value is near 1: subnormals keep all their digits.
struct ReferenceSvd {
  int exponent = 0;
  std::vector<double> values;  // min(rows, columns), descending
  std::vector<double> V;       // columns x columns, row-major
};

// Householder QR of the rows, then Jacobi rotations of R. With a `period` p, of the first p rows,
// whose singular values are those of all rows by the root of how often they come.
ReferenceSvd reference_svd(const Matrix& matrix, std::size_t period);

}  // namespace weft::numerics
