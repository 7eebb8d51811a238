// Inner products of columns in double: the reference of kernels/gram.cl.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft::reference {

// G(i, j) = sum over p < n of X(p, i) Z(p, j), row-major columns_x x columns_z, of row-major X
// (n x columns_x) and Z (n x columns_z).
std::vector<double> gram(std::size_t n, std::size_t columns_x, std::span<const double> X,
                         std::size_t columns_z, std::span<const double> Z);

}  // namespace weft::reference
