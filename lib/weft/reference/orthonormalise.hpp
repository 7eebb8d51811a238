// Orthonormal bases in double: the reference of host/weft/ops/orthonormalise.hpp.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft::reference {

// The left singular vectors of Y D, D = diag(1 / |y_j|), with its singular values. Y is row-major
// n x count; zero columns stay zero.
struct ColumnSpace {
  std::vector<double> values;  // min(n, count), descending
  std::vector<double> Q;       // n x min(n, count)
};
ColumnSpace orthonormalise(std::size_t n, std::size_t count, std::span<const double> Y);

// Y <- Y - Q (Q^T Y) for row-major Q (n x q_count) and Y (n x count).
void project_out(std::size_t n, std::span<const double> Q, std::size_t q_count, std::span<double> Y,
                 std::size_t count);

}  // namespace weft::reference
