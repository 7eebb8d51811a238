// The triangular factor of a tall matrix against an SVD and the Gram matrix in double, at sizes
// about the panel (24 or 48 columns in f32, 12 or 24 in f64), the block (1024 rows), the batch
// (8192) and the levels of the tree (131072 rows, and 2^21), for matrices of any rank, condition
// and magnitude.
#include "weft/ops/tsqr.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "ops/matrices.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/gram.hpp"
#include "weft/reference/tsqr.hpp"

namespace weft::test {
namespace {

template <typename Real>
constexpr Arithmetic arithmetic_of = sizeof(Real) == 4 ? Arithmetic::f32 : Arithmetic::f64;
template <typename Real>
constexpr double roundoff_of = sizeof(Real) == 4 ? float_roundoff : double_roundoff;

// A K x m matrix of values that Real holds.
template <typename Real>
struct Matrix {
  std::size_t K = 0;
  std::size_t m = 0;
  std::vector<Real> values;  // row-major

  Matrix(std::size_t K_, std::size_t m_) : K(K_), m(m_), values(K_ * m_) {}
  template <typename T>
  Matrix(std::size_t K_, std::size_t m_, const std::vector<T>& from) : Matrix(K_, m_) {
    std::transform(from.begin(), from.end(), values.begin(),
                   [](T value) { return static_cast<Real>(value); });
  }
  std::vector<double> widened() const { return {values.begin(), values.end()}; }
  Real& at(std::size_t i, std::size_t j) { return values[i * m + j]; }
};

// Rows [first, first + count) as packed panels between guards; columns past the last are NaN, which
// must not get anywhere.
template <typename Real>
GuardedBuffer packed(const Matrix<Real>& X, std::size_t first, std::size_t count) {
  const std::size_t width = ops::panel_width(shared_device(), arithmetic_of<Real>);
  std::vector<Real> panels(ops::round_up(X.m, width) * count,
                           std::numeric_limits<Real>::quiet_NaN());
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j < X.m; ++j) {
      panels[(j / width * count + i) * width + j % width] = X.values[(first + i) * X.m + j];
    }
  }
  return GuardedBuffer(shared_device(), std::span<const Real>(panels), "rows");
}

using Workspace = ops::Tsqr::Workspace;

// R of X, added by `at_once` rows.
template <typename Real>
std::vector<double> factor(const Matrix<Real>& X, std::size_t at_once,
                           Workspace workspace = Workspace::ample) {
  ops::Tsqr tsqr(shared_device(), X.m, arithmetic_of<Real>, workspace);
  for (std::size_t first = 0; first < X.K; first += at_once) {
    const std::size_t count = std::min(at_once, X.K - first);
    GuardedBuffer rows = packed(X, first, count);
    tsqr.add(rows.buffer(), count);
    EXPECT_TRUE(rows.intact());
  }
  return tsqr.R();
}

// |e_j| / |x_j| of the backward error E, X + E = Q R. A row passes through one block or triangle
// after the other: at most 16 in its chain, 3 merges of chains, and 16 in a level above (blocks of
// 1024 rows in 8 chains, or of 256 in 2); each is m reflectors. One leaves the rounding of its
// sums, of 64 + rows / 128 + 3 terms in a row, of tau and v (8) and of its update (3). Roundings
// are taken as independent (Higham & Mary 2019: the root of their number, times 4 for any
// probability that matters).
template <typename Real>
double backward_error(std::size_t K, std::size_t m, Workspace workspace = Workspace::ample) {
  const std::size_t block = workspace == Workspace::ample ? 1024 : 256;
  const std::size_t batch = block * (workspace == Workspace::ample ? 8 : 2);
  const double rows = static_cast<double>(std::min(K, block));
  const double terms = std::min(rows, 64.0) + rows / 128 + 3 + 8 + 3;
  const double blocks = std::ceil(static_cast<double>(K) / static_cast<double>(batch));
  const double reductions =
      std::min(blocks, 16.0) + (K > block ? 3 : 0) + std::min(blocks / 16, 16.0) + blocks / 256;
  return 4 * std::sqrt(static_cast<double>(m) * reductions * terms) * roundoff_of<Real>;
}

double column_norm(std::span<const double> gram, std::size_t m, std::size_t j) {
  return std::sqrt(gram[j * m + j]);
}

// R is upper triangular; R^T R is X^T X to within twice the backward error times the lengths of two
// columns; and its singular values are those of X to within |E|. Subnormal columns are off by half
// a step of their arithmetic per operation beside.
template <typename Real>
std::vector<double> expect_factor(const Matrix<Real>& X, Workspace workspace = Workspace::ample) {
  SCOPED_TRACE(testing::Message() << "K " << X.K << ", m " << X.m << ", f" << 8 * sizeof(Real));
  const std::vector<double> R = factor(X, X.K, workspace);
  const std::size_t m = X.m;
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_EQ(R[i * m + j], 0.0) << i << ", " << j;
  }
  const std::vector<double> wide = X.widened();
  const std::vector<double> expected = reference::gram(X.K, m, wide, m, wide);
  const std::vector<double> actual = reference::gram(m, m, R, m, R);
  const double bound = backward_error<Real>(X.K, m, workspace);
  const double step = std::sqrt(static_cast<double>(X.K * m)) *
                      static_cast<double>(std::numeric_limits<Real>::denorm_min());
  const double own = 2 * gamma(static_cast<double>(X.K + m), double_roundoff);
  EXPECT_TRUE(all_near(actual, expected, [&](std::size_t at) {
    const double a = column_norm(expected, m, at / m);
    const double b = column_norm(expected, m, at % m);
    return (2 * bound + bound * bound + own) * a * b + step * (a + b) + step * step;
  }));

  double square = 0;
  for (std::size_t j = 0; j < m; ++j) square += expected[j * m + j];
  // a zero or subnormal row changes nothing but lets K < m be decomposed like any other
  std::vector<double> rows = wide;
  rows.resize(std::max(X.K, m) * m, 0.0);
  const std::vector<double> sigma =
      reference::thin_svd(m, m, reference::triangular_factor(std::max(X.K, m), m, rows)).values;
  const double dimension = std::sqrt(static_cast<double>(m * (X.K + m)));
  EXPECT_TRUE(all_near(reference::thin_svd(m, m, R).values, sigma,
                       (bound + 2 * dimension * double_roundoff) * std::sqrt(square) + step));
  return R;
}

template <typename Real>
Matrix<Real> random_matrix(std::size_t K, std::size_t m, std::uint64_t seed) {
  return {K, m, random_floats(K * m, seed, -1.0, 1.0)};
}

// X D: column j times 10^exponent(j).
template <typename Real, typename Exponent>
void scale_columns(Matrix<Real>& X, const Exponent& exponent) {
  for (std::size_t i = 0; i < X.K; ++i) {
    for (std::size_t j = 0; j < X.m; ++j) {
      X.at(i, j) = static_cast<Real>(static_cast<double>(X.at(i, j)) * std::pow(10.0, exponent(j)));
    }
  }
}

template <typename Real>
class Tsqr : public testing::Test {};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(Tsqr, Reals);

TYPED_TEST(Tsqr, SmallOfAnyShape) {
  expect_factor(random_matrix<TypeParam>(30, 50, 1));
  expect_factor(random_matrix<TypeParam>(60, 26, 1));
  expect_factor(random_matrix<TypeParam>(7, 5, 2));
  expect_factor(random_matrix<TypeParam>(3, 27, 3));
  expect_factor(random_matrix<TypeParam>(1, 1, 4));
}

TYPED_TEST(Tsqr, StraddlesThePanel) {
  for (const std::size_t m : Sizes{1, 2, 11, 12, 13, 23, 24, 25, 36, 47, 48, 49, 73, 97}) {
    for (const std::size_t K : Sizes{1, 2, 3, 4, 5, 7, 8, 9, 24, 50, 127, 128, 129, 130}) {
      expect_factor(random_matrix<TypeParam>(K, m, 5));
    }
  }
}

TYPED_TEST(Tsqr, StraddlesTheBlockAndTheBatch) {
  for (const std::size_t K :
       Sizes{511, 513, 1023, 1024, 1025, 2500, 8191, 8192, 8193, 9217, 17000}) {
    expect_factor(random_matrix<TypeParam>(K, 30, 6));
  }
  expect_factor(random_matrix<TypeParam>(132000, 5, 7));
}

// Blocks of 256 rows in 2 chains.
TYPED_TEST(Tsqr, LeanStraddlesTheBlockAndTheBatch) {
  for (const std::size_t K : Sizes{1, 255, 256, 257, 511, 512, 513, 2500, 8191, 8192, 8193}) {
    expect_factor(random_matrix<TypeParam>(K, 30, 6), Workspace::lean);
  }
  expect_factor(random_matrix<TypeParam>(140000, 5, 7), Workspace::lean);  // all three levels
  expect_factor(random_matrix<TypeParam>(700, 260, 8), Workspace::lean);
}

TYPED_TEST(Tsqr, WideMatrices) {
  expect_factor(random_matrix<TypeParam>(700, 260, 8));
  expect_factor(random_matrix<TypeParam>(100, 300, 9));
}

// Fewer chains.
TYPED_TEST(Tsqr, ManyColumns) {
  const std::size_t m = 1030;
  const Matrix<TypeParam> X = random_matrix<TypeParam>(2200, m, 10);
  const std::vector<double> R = factor(X, 1000);
  const std::vector<double> wide = X.widened();
  const double bound = 2 * backward_error<TypeParam>(2200, m) * std::sqrt(2200.0);
  // lengths of columns, and their products with the first and the last
  for (std::size_t j = 0; j < m; ++j) {
    for (const std::size_t i : {std::size_t{0}, j, m - 1}) {
      double expected = 0;
      double actual = 0;
      for (std::size_t k = 0; k < X.K; ++k) expected += wide[k * m + i] * wide[k * m + j];
      for (std::size_t k = 0; k < m; ++k) actual += R[k * m + i] * R[k * m + j];
      ASSERT_NEAR(actual, expected, bound * std::sqrt(2200.0)) << i << ", " << j;
    }
  }
}

// The same R whatever add()s the rows come in, to the bit.
TYPED_TEST(Tsqr, TheSameBitsHoweverRowsAreAdded) {
  const Matrix<TypeParam> X = random_matrix<TypeParam>(9000, 27, 11);
  const std::vector<double> whole = factor(X, 9000);
  for (const std::size_t at_once : Sizes{1, 37, 1024, 8192, 8193}) {
    if (at_once == 1 && sizeof(TypeParam) == 8) continue;
    EXPECT_TRUE(same_bits(factor(X, at_once), whole)) << at_once;
  }
}

TYPED_TEST(Tsqr, GoesOnAfterR) {
  const Matrix<TypeParam> X = random_matrix<TypeParam>(900, 30, 12);
  ops::Tsqr tsqr(shared_device(), 30, arithmetic_of<TypeParam>);
  EXPECT_TRUE(all_equal(tsqr.R(), std::vector<double>(900, 0.0)));
  for (const std::size_t first : Sizes{0, 300, 600}) {
    const GuardedBuffer rows = packed(X, first, 300);
    tsqr.add(rows.buffer(), 300);
    const std::vector<double> R = tsqr.R();
    EXPECT_TRUE(same_bits(tsqr.R(), R));
    const std::vector<double> part(
        X.values.begin(), X.values.begin() + static_cast<std::ptrdiff_t>((first + 300) * 30));
    const std::vector<double> expected = reference::gram(first + 300, 30, part, 30, part);
    EXPECT_TRUE(all_near(reference::gram(30, 30, R, 30, R), expected,
                         2 * backward_error<TypeParam>(3 * 8192, 30) * 900));
  }
}

// Singular values down to the backward error are there: a Gram matrix would lose those below the
// root of the roundoff.
TYPED_TEST(Tsqr, ResolvesGradedSpectra) {
  const std::size_t m = 16;
  const double last = sizeof(TypeParam) == 4 ? -5.5 : -13.0;
  std::vector<double> sigma(m);
  for (std::size_t j = 0; j < m; ++j) {
    sigma[j] = std::pow(10.0, last * static_cast<double>(j) / static_cast<double>(m - 1));
  }
  const Matrix<TypeParam> X(600, m, matrix_with_singular_values(600, m, sigma, 13));
  const std::vector<double> R = expect_factor(X);
  const double smallest = reference::thin_svd(m, m, R).values[m - 1];
  EXPECT_GT(smallest, 0.5 * sigma[m - 1]);
  EXPECT_LT(smallest, 2 * sigma[m - 1]);
}

TYPED_TEST(Tsqr, ColumnsOfAnyMagnitude) {
  for (const std::size_t K : Sizes{20, 1500}) {
    Matrix<TypeParam> falling = random_matrix<TypeParam>(K, 31, 14);
    scale_columns(falling, [](std::size_t j) { return 30.0 - 2.0 * static_cast<double>(j); });
    expect_factor(falling);
    Matrix<TypeParam> rising = random_matrix<TypeParam>(K, 31, 15);
    scale_columns(rising, [](std::size_t j) { return -30.0 + 2.0 * static_cast<double>(j); });
    expect_factor(rising);
    Matrix<TypeParam> mixed = random_matrix<TypeParam>(K, 31, 16);
    scale_columns(mixed, [](std::size_t j) { return j % 2 == 0 ? 30.0 : -30.0; });
    expect_factor(mixed);
  }
}

TYPED_TEST(Tsqr, RowsOfAnyMagnitude) {
  for (const std::size_t m : Sizes{1, 25}) {
    Matrix<TypeParam> X = random_matrix<TypeParam>(700, m, 17);
    for (std::size_t i = 0; i < X.K; ++i) {
      const double factor =
          std::pow(10.0, -30.0 + 60.0 * static_cast<double>(i * 397 % 700) / 699.0);
      for (std::size_t j = 0; j < m; ++j) {
        X.at(i, j) = static_cast<TypeParam>(static_cast<double>(X.at(i, j)) * factor);
      }
    }
    expect_factor(X);
  }
}

TYPED_TEST(Tsqr, SubnormalColumns) {
  Matrix<TypeParam> X = random_matrix<TypeParam>(200, 26, 18);
  const TypeParam least = std::numeric_limits<TypeParam>::denorm_min();
  for (std::size_t i = 0; i < X.K; ++i) {
    for (const std::size_t j : Sizes{0, 7, 25}) {
      X.at(i, j) = static_cast<TypeParam>(std::round(1000 * X.at(i, j))) * least;
    }
  }
  expect_factor(X);
  expect_factor(Matrix<TypeParam>(3, 1, std::vector<TypeParam>{least, -least, 0}));
}

TYPED_TEST(Tsqr, ZeroEqualAndDependentColumns) {
  EXPECT_TRUE(all_equal(factor(Matrix<TypeParam>(600, 30), 600), std::vector<double>(900, 0.0)));
  for (const std::size_t K : Sizes{10, 1500, 9000}) {
    Matrix<TypeParam> X = random_matrix<TypeParam>(K, 40, 19);
    for (std::size_t i = 0; i < K; ++i) {
      for (const std::size_t zero : Sizes{0, 3, 24, 39}) X.at(i, zero) = 0;
      X.at(i, 10) = X.at(i, 9);
      X.at(i, 30) = X.at(i, 9);
      X.at(i, 31) = -2 * X.at(i, 5);
    }
    const std::vector<double> R = expect_factor(X);
    for (std::size_t i = 0; i < 40; ++i) {
      for (const std::size_t zero : Sizes{0, 3, 24, 39}) EXPECT_EQ(R[i * 40 + zero], 0.0);
    }
  }
  // rank 1
  Matrix<TypeParam> ones(1000, 26);
  std::fill(ones.values.begin(), ones.values.end(), TypeParam{1});
  expect_factor(ones);
}

// 2^21 rows and more: up to the third level. The Gram matrix is known: the same rows 17 times.
TYPED_TEST(Tsqr, LongAccumulation) {
  const std::size_t K = 131072;
  const std::size_t times = 17;
  const Matrix<TypeParam> X = random_matrix<TypeParam>(K, 3, 20);
  const GuardedBuffer rows = packed(X, 0, K);
  ops::Tsqr tsqr(shared_device(), 3, arithmetic_of<TypeParam>);
  for (std::size_t i = 0; i < times; ++i) tsqr.add(rows.buffer(), K);
  const std::vector<double> R = tsqr.R();
  const std::vector<double> wide = X.widened();
  std::vector<double> expected = reference::gram(K, 3, wide, 3, wide);
  for (double& value : expected) value *= static_cast<double>(times);
  const double bound = 2 * backward_error<TypeParam>(K * times, 3) +
                       2 * gamma(static_cast<double>(K), double_roundoff);
  EXPECT_TRUE(all_near(reference::gram(3, 3, R, 3, R), expected, bound * expected[0]));
}

TYPED_TEST(Tsqr, RefusesWhatIsNotFinite) {
  for (const TypeParam bad :
       {std::numeric_limits<TypeParam>::quiet_NaN(), std::numeric_limits<TypeParam>::infinity()}) {
    for (const std::size_t row : Sizes{0, 299, 599}) {
      Matrix<TypeParam> X = random_matrix<TypeParam>(600, 30, 21);
      X.at(row, 29) = bad;
      expect_error(ErrorKind::runtime, {"column 29"}, [&] { factor(X, 600); });
    }
  }
}

TYPED_TEST(Tsqr, TakesTheBytesItForesees) {
  Device& device = shared_device();
  for (const Workspace workspace : {Workspace::ample, Workspace::lean}) {
    for (const std::size_t m : Sizes{1, 30, 1200}) {
      const std::size_t before = device.allocated();
      const ops::Tsqr tsqr(device, m, arithmetic_of<TypeParam>, workspace);
      const std::size_t foreseen = ops::Tsqr::bytes(device, m, arithmetic_of<TypeParam>, workspace);
      EXPECT_LE(device.allocated() - before, foreseen);
      EXPECT_GE(2 * (device.allocated() - before), foreseen - 2 * m * m * sizeof(double));
    }
  }
}

TEST(TriangularFactor, BlocksGiveTheSameGram) {
  const std::vector<float> X = random_floats(70 * 6, 22, -1.0, 1.0);
  const std::vector<double> wide = widened(X);
  const std::vector<double> expected = reference::gram(70, 6, wide, 6, wide);
  for (const std::size_t rows : Sizes{1, 3, 6, 7, 70, 100}) {
    const std::vector<double> R = reference::tsqr(70, 6, wide, rows);
    EXPECT_TRUE(
        all_near(reference::gram(6, 6, R, 6, R), expected, 70 * gamma(70 * 6.0, double_roundoff)));
  }
}

}  // namespace
}  // namespace weft::test
