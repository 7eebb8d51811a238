// Factorisations in double: U, V and the values of an SVD have to fit the matrix, whatever its
// spectrum.
#include "weft/reference/factorise.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/reference/gemm.hpp"
#include "weft/reference/gram.hpp"
#include "weft/reference/tsqr.hpp"

namespace weft::test {
namespace {

std::vector<double> transpose(std::size_t rows, std::size_t columns, std::span<const double> A) {
  std::vector<double> result(A.size());
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) result[j * rows + i] = A[i * columns + j];
  }
  return result;
}

// A = U diag(values) V^T, U^T U = I and V^T V = I, each to within n eps |A| with a modest constant.
void expect_svd(std::size_t rows, std::size_t columns, std::span<const double> A) {
  const std::size_t r = std::min(rows, columns);
  const reference::ThinSvd svd = reference::thin_svd(rows, columns, A);
  ASSERT_EQ(svd.values.size(), r);
  EXPECT_TRUE(std::is_sorted(svd.values.rbegin(), svd.values.rend()));
  double square = 0;
  for (const double value : A) square += value * value;
  const double rounding =
      20 * static_cast<double>(std::max(rows, columns)) * std::numeric_limits<double>::epsilon();

  std::vector<double> scaled = svd.U;
  for (std::size_t at = 0; at < scaled.size(); ++at) scaled[at] *= svd.values[at % r];
  std::vector<double> product(rows * columns);
  reference::gemm(rows, columns, r, 1.0, scaled, transpose(columns, r, svd.V), 0.0, product);
  EXPECT_TRUE(all_near(product, A, rounding * std::sqrt(square)));

  std::vector<double> identity(r * r, 0.0);
  for (std::size_t j = 0; j < r; ++j) identity[j * r + j] = 1;
  EXPECT_TRUE(all_near(reference::gram(rows, r, svd.U, r, svd.U), identity, rounding));
  EXPECT_TRUE(all_near(reference::gram(columns, r, svd.V, r, svd.V), identity, rounding));
}

TEST(ThinSvd, OfAnyShape) {
  for (const std::size_t rows : Sizes{1, 5, 40}) {
    for (const std::size_t columns : Sizes{1, 5, 40}) {
      expect_svd(rows, columns, random_values(rows * columns, 1, -1.0, 1.0));
    }
  }
  expect_svd(20, 20, std::vector<double>(400, 0.0));
}

TEST(ThinSvd, OfGradedSpectra) {
  std::vector<double> values(60);
  for (std::size_t j = 0; j < values.size(); ++j)
    values[j] = std::pow(10.0, -static_cast<double>(j) / 4);
  expect_svd(80, 60, matrix_with_singular_values(80, 60, values, 2));
}

// H D G^T with Hadamard matrices H (512 x 16) and G (64 x 16): eight equal singular values, eight
// of 2^-18 of them, and 48 of zero. Triangular factors of it, which differ by the blocks of their
// rows, are where divide and conquer was seen to fail.
TEST(ThinSvd, OfRepeatedValues) {
  const auto hadamard = [](std::size_t i, std::size_t j) {
    return std::popcount(i & j) % 2 == 0 ? 1.0 : -1.0;
  };
  std::vector<double> X(512 * 64, 0.0);
  for (std::size_t i = 0; i < 512; ++i) {
    for (std::size_t j = 0; j < 64; ++j) {
      for (std::size_t l = 0; l < 16; ++l) {
        X[i * 64 + j] += hadamard(i, l) * (l < 8 ? 1.0 : 0x1p-18) * hadamard(j, l) / 8;
      }
    }
  }
  expect_svd(512, 64, X);
  for (const std::size_t block : Sizes{1, 3, 64, 100, 300, 512}) {
    SCOPED_TRACE(block);
    const std::vector<double> R = reference::tsqr(512, 64, X, block);
    expect_svd(64, 64, R);
    const std::vector<double> values = reference::thin_svd(64, 64, R).values;
    for (std::size_t j = 0; j < 64; ++j) {
      const double expected = std::sqrt(512.0) * (j < 8 ? 1.0 : j < 16 ? 0x1p-18 : 0.0);
      EXPECT_NEAR(values[j], expected, 20 * 512 * 0x1p-52 * std::sqrt(512.0)) << j;
    }
  }
}

}  // namespace
}  // namespace weft::test
