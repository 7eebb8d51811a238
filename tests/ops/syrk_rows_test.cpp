// Products of a few long rows with their own transpose against the reference, in float and double,
// at sizes about the tile (3 or 5 rows), the vector, the depth of a block (2048 columns for few
// rows, fewer for more) and the number of slices (32).
#include "weft/ops/syrk_rows.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <ostream>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::test {
namespace {

struct Case {
  std::size_t m = 1;
  std::size_t K = 1;
  double alpha = 1;
  double beta = 0;
  ops::Written written = ops::Written::lower;
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << "m " << c.m << " K " << c.K << ", alpha " << c.alpha << ", beta " << c.beta << ", "
             << (c.written == ops::Written::lower ? "lower" : "upper");
}

template <typename Real>
constexpr Arithmetic arithmetic_of = sizeof(Real) == sizeof(float) ? Arithmetic::f32
                                                                   : Arithmetic::f64;

bool is_written(const Case& c, std::size_t i, std::size_t j) {
  return c.written == ops::Written::lower ? j <= i : j >= i;
}

// The triangle of C, zero beside it, after what lies outside has been checked. X and C lie inside
// larger matrices.
template <typename Real>
std::vector<Real> multiply(const Case& c, const std::vector<Real>& X, const std::vector<Real>& C) {
  Device& device = shared_device();
  GuardedBuffer rows(device, std::span<const Real>(with_leading(X, c.m, c.K, c.K + 3, 5)), "X");
  const std::size_t leading = c.m + 2;
  const std::vector<Real> before = with_leading(C, c.m, c.m, leading);
  GuardedBuffer out(device, std::span<const Real>(before), "C");
  ops::syrk_rows(device, c.m, c.K, c.alpha, {&rows.buffer(), 5, c.K + 3}, c.beta,
                 ops::to_row_major(device, out.buffer(), leading, 0, arithmetic_of<Real>),
                 c.written, arithmetic_of<Real>);
  const std::vector<Real> stored = out.template values<Real>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(rows.intact());
  std::vector<Real> around = stored;
  std::vector<Real> triangle(c.m * c.m, Real{0});
  for (std::size_t i = 0; i < c.m; ++i) {
    for (std::size_t j = 0; j < c.m; ++j) {
      if (!is_written(c, i, j)) continue;
      around[i * leading + j] = before[i * leading + j];
      triangle[i * c.m + j] = stored[i * leading + j];
    }
  }
  EXPECT_TRUE(same_bits(around, before));
  return triangle;
}

// alpha X X^T + beta C in double, from the magnitudes of all for a bound.
std::vector<double> expected_product(const Case& c, const std::vector<double>& X,
                                     const std::vector<double>& C) {
  std::vector<double> expected = C;
  reference::gemm(c.m, c.m, c.K, c.alpha, X, transpose(X, c.m, c.K), c.beta, expected);
  for (std::size_t i = 0; i < c.m; ++i) {
    for (std::size_t j = 0; j < c.m; ++j) {
      if (!is_written(c, i, j)) expected[i * c.m + j] = 0;
    }
  }
  return expected;
}

template <typename Real>
void expect_exact(const Case& c) {
  SCOPED_TRACE(testing::Message() << c);
  const std::vector<double> X = widened(random_integers(c.K * c.m, 1));
  // Where beta is 0, C holds NaN: it must not be read.
  const std::vector<double> C = c.beta == 0 ? std::vector<double>(c.m * c.m, double{unused})
                                            : widened(random_integers(c.m * c.m, 2));
  EXPECT_TRUE(
      all_equal(multiply(c, values_as<Real>(X), values_as<Real>(C)), expected_product(c, X, C)));
}

template <typename Real>
class SyrkRows : public testing::Test {};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(SyrkRows, Reals);

TYPED_TEST(SyrkRows, SmallIsExact) {
  for (const std::size_t m : Sizes{1, 3, 6, 11}) {
    expect_exact<TypeParam>({m, 3, 1, 0});
    expect_exact<TypeParam>({m, 37, -2, 0.5, ops::Written::upper});
  }
}

TYPED_TEST(SyrkRows, StraddlesTilesAndVectors) {
  for (const std::size_t m : Sizes{1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 14, 15, 16, 81}) {
    for (const std::size_t K : Sizes{1, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 100}) {
      expect_exact<TypeParam>({m, K, 1, 0});
      expect_exact<TypeParam>({m, K, 0.5, 1, ops::Written::upper});
    }
  }
}

TYPED_TEST(SyrkRows, StraddlesBlocksAndSlices) {
  for (const std::size_t K : Sizes{2047, 2048, 2049, 4095, 4097, 65535, 65536, 65537, 140001}) {
    expect_exact<TypeParam>({4, K, 1, 0});
  }
  for (const std::size_t K : Sizes{575, 576, 577, 1151, 1152, 1153, 5000, 37000}) {
    expect_exact<TypeParam>({81, K, 0.5, 2});
  }
  expect_exact<TypeParam>({ops::most_long_rows, 400, 1, 0});
}

TYPED_TEST(SyrkRows, RoundingErrorIsBounded) {
  const double u = sizeof(TypeParam) == sizeof(float) ? float_roundoff : double_roundoff;
  for (const std::size_t K : Sizes{1, 17, 1000, 3000, 70000}) {
    const Case c{19, K, -0.75, 1.25};
    SCOPED_TRACE(testing::Message() << c);
    const std::vector<TypeParam> X = values_as<TypeParam>(random_values(K * c.m, 3, -1.0, 1.0));
    const std::vector<TypeParam> C = values_as<TypeParam>(random_values(c.m * c.m, 4, -1.0, 1.0));
    const std::vector<double> wide_x(X.begin(), X.end());
    const std::vector<double> wide_c(C.begin(), C.end());
    const std::vector<double> expected = expected_product(c, wide_x, wide_c);
    const std::vector<double> size =
        expected_product({c.m, K, 0.75, 1.25}, magnitudes(X), magnitudes(C));
    const double terms =
        static_cast<double>(ops::syrk_rows_terms(c.m, K, arithmetic_of<TypeParam>));
    // the reference's own error counts where the device computes in double
    const double bound = gamma(terms, u) + gamma(static_cast<double>(K) + 2, double_roundoff);
    EXPECT_TRUE(
        all_near(multiply(c, X, C), expected, [&](std::size_t i) { return bound * size[i]; }));
  }
}

TYPED_TEST(SyrkRows, TheSameBitsAgain) {
  const Case c{50, 5000, 1, 0};
  const std::vector<TypeParam> X = values_as<TypeParam>(random_values(c.K * c.m, 5, -1.0, 1.0));
  const std::vector<TypeParam> C(c.m * c.m, TypeParam{0});
  EXPECT_TRUE(same_bits(multiply(c, X, C), multiply(c, X, C)));
}

// A NaN or an infinity in row j reaches row j and column j of C, and nothing else.
TYPED_TEST(SyrkRows, NonFiniteValuesStayInTheirRow) {
  for (const double bad : {double{unused}, std::numeric_limits<double>::infinity()}) {
    const Case c{22, 1000, 1, 0};
    std::vector<double> X = random_values(c.K * c.m, 6, 0.5, 1.0);
    X[21 * c.K + 999] = bad;  // the last row is read in place of those past it
    const std::vector<TypeParam> C =
        multiply(c, values_as<TypeParam>(X), std::vector<TypeParam>(c.m * c.m, TypeParam{0}));
    for (std::size_t i = 0; i < c.m; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        EXPECT_EQ(std::isfinite(C[i * c.m + j]), i != 21) << i << ", " << j;
      }
    }
  }
}

// ops::syrk takes this way for such shapes: what it promises covers it.
TYPED_TEST(SyrkRows, GeneralProductsForeseeIt) {
  Device& device = shared_device();
  const ops::ProductOptions options{arithmetic_of<TypeParam>};
  for (const std::size_t m : Sizes{1, 5, 81, 243, 512}) {
    for (const std::size_t K : Sizes{16, 100, 2000, 2049, 16384, 65536, 250000, 100000000}) {
      EXPECT_LE(ops::syrk_rows_terms(m, K, options.arithmetic),
                ops::product_terms(device, K, options))
          << m << " x " << K;
      if (K >= 16 * m) {
        EXPECT_LE(ops::syrk_rows_bytes(m, K, options.arithmetic),
                  ops::product_bytes(device, m, K, options));
      }
    }
  }
  Device own("auto");
  Buffer X(own, 81 * 20000 * sizeof(TypeParam), "X");
  Buffer C(own, 81 * 81 * sizeof(TypeParam), "C");
  own.fill_zero(X, 0, X.size());
  const std::size_t before = own.allocated();
  ops::syrk(own, ops::Triangle::lower, ops::Transpose::no, 81, 20000, 1, {X, 20000}, 0, {C, 81},
            options);
  EXPECT_LE(own.peak_allocated() - before, ops::product_bytes(own, 81, 20000, options));
  EXPECT_GE(own.peak_allocated() - before, ops::syrk_rows_bytes(81, 20000, options.arithmetic));
}

}  // namespace
}  // namespace weft::test
