// Tensors in double, row-major: unfoldings, mode-n products and Gram matrices, plainly. The truth
// that host/weft/ops/mode_product.hpp is checked against.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft::reference {

// Values of a row-major tensor of these sizes.
std::size_t elements_of(std::span<const std::size_t> sizes);

// T_(n): row j holds T(..., j, ...) with the other indices in storage order, [I_n][all others]
// (Kolda & Bader 2009, but for the order of the columns, which no result depends on).
std::vector<double> unfold(std::span<const std::size_t> sizes, std::size_t mode,
                           std::span<const double> T);

// T x_n M with M(j, i) row-major [rows][I_n]: mode n becomes `rows` long.
std::vector<double> mode_product(std::span<const std::size_t> sizes, std::size_t mode,
                                 std::span<const double> T, std::size_t rows,
                                 std::span<const double> M);

// M^T of a row-major rows x columns matrix.
std::vector<double> transposed(std::size_t rows, std::size_t columns, std::span<const double> M);

// T_(n) T_(n)^T.
std::vector<double> mode_gram(std::span<const std::size_t> sizes, std::size_t mode,
                              std::span<const double> T);

}  // namespace weft::reference
