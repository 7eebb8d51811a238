// Products of a matrix with its own transpose against the reference, in float and double, at sizes
// about the micro-tile, the panel, the macro-tile (96 rows, 8 panels) and the depth of a block
// (10 panels); long sums are cut in slices.
#include "weft/ops/syrk.hpp"

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
#include "weft/ops/launch.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::test {
namespace {

struct Case {
  std::size_t m = 1;
  std::size_t K = 1;
  double alpha = 1;
  double beta = 0;
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << "m " << c.m << " K " << c.K << ", alpha " << c.alpha << ", beta " << c.beta;
}

template <typename Real>
constexpr Arithmetic arithmetic_of() {
  return sizeof(Real) == sizeof(float) ? Arithmetic::f32 : Arithmetic::f64;
}

// The lower triangle of C, zero above, after what lies outside C has been checked.
template <typename Real>
std::vector<Real> multiply(const Case& c, const std::vector<Real>& X, const std::vector<Real>& C) {
  Device& device = shared_device();
  constexpr Arithmetic arithmetic = arithmetic_of<Real>();
  const std::size_t width = ops::panel_width(device, arithmetic);
  GuardedBuffer packed(device, std::span<const Real>(panels_of(X, c.K, c.m, width, Real{0})),
                       "packed X");
  const std::size_t leading = c.m + 2;
  const std::vector<Real> before = with_leading(C, c.m, c.m, leading);
  GuardedBuffer out(device, std::span<const Real>(before), "C");
  ops::syrk_packed(device, c.m, c.K, c.alpha, packed.buffer(), c.beta, out.buffer(), leading,
                   arithmetic);
  const std::vector<Real> stored = out.template values<Real>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(packed.intact());
  std::vector<Real> around = stored;
  std::vector<Real> lower(c.m * c.m, Real{0});
  for (std::size_t i = 0; i < c.m; ++i) {
    for (std::size_t j = 0; j < c.m; ++j) {
      around[i * leading + j] = before[i * leading + j];
      if (j <= i) lower[i * c.m + j] = stored[i * leading + j];
    }
  }
  EXPECT_TRUE(same_bits(around, before));
  return lower;
}

std::vector<double> lower_triangle(std::vector<double> C, std::size_t m) {
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = i + 1; j < m; ++j) C[i * m + j] = 0;
  }
  return C;
}

// alpha X^T X + beta C in double, from the magnitudes of all for a bound.
std::vector<double> expected_product(const Case& c, const std::vector<double>& X,
                                     const std::vector<double>& C) {
  std::vector<double> expected = C;
  reference::gemm(c.m, c.m, c.K, c.alpha, transpose(X, c.K, c.m), X, c.beta, expected);
  return lower_triangle(expected, c.m);
}

template <typename Real>
class Syrk : public testing::Test {};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(Syrk, Reals);

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

TYPED_TEST(Syrk, SmallIsExact) {
  for (const std::size_t m : Sizes{1, 4, 5, 13, 25}) {
    expect_exact<TypeParam>({m, 3, 1, 0});
    expect_exact<TypeParam>({m, 7, -2, 0.5});
  }
}

TYPED_TEST(Syrk, StraddlesMicroTilesAndPanels) {
  for (const std::size_t m : Sizes{1, 2, 3, 4, 5, 7, 8, 9, 11, 12, 13, 23, 24, 25, 47, 48, 49}) {
    expect_exact<TypeParam>({m, 5, 1, 0});
    expect_exact<TypeParam>({m, 6, 0.5, 1});
  }
}

TYPED_TEST(Syrk, StraddlesMacroTiles) {
  for (const std::size_t m : Sizes{95, 96, 97, 191, 192, 193, 289, 400}) {
    expect_exact<TypeParam>({m, 31, 1, 0});
    expect_exact<TypeParam>({m, 30, 1, -1});
  }
}

TYPED_TEST(Syrk, StraddlesBlocksAndSlices) {
  for (const std::size_t K : Sizes{1, 119, 120, 121, 239, 240, 241, 479, 481, 1921, 5000, 20001}) {
    expect_exact<TypeParam>({9, K, 1, 0});
    expect_exact<TypeParam>({50, K, 0.5, 2});
  }
}

TYPED_TEST(Syrk, RoundingErrorIsBounded) {
  Device& device = shared_device();
  const double u = sizeof(TypeParam) == sizeof(float) ? float_roundoff : double_roundoff;
  for (const std::size_t K : Sizes{1, 120, 241, 3000, 70000}) {
    const Case c{29, K, -0.75, 1.25};
    SCOPED_TRACE(testing::Message() << c);
    const std::vector<TypeParam> X = values_as<TypeParam>(random_values(K * c.m, 3, -1.0, 1.0));
    const std::vector<TypeParam> C = values_as<TypeParam>(random_values(c.m * c.m, 4, -1.0, 1.0));
    const std::vector<double> wide_x(X.begin(), X.end());
    const std::vector<double> wide_c(C.begin(), C.end());
    const std::vector<double> expected = expected_product(c, wide_x, wide_c);
    const std::vector<double> size =
        expected_product({c.m, K, 0.75, 1.25}, magnitudes(X), magnitudes(C));
    // the reference's own error counts where the device computes in double
    const double terms =
        static_cast<double>(ops::syrk_terms(device, c.m, K, arithmetic_of<TypeParam>()));
    const double bound = gamma(terms, u) + gamma(static_cast<double>(K) + 2, double_roundoff);
    EXPECT_TRUE(
        all_near(multiply(c, X, C), expected, [&](std::size_t i) { return bound * size[i]; }));
    // long sums don't pile up their errors
    EXPECT_LT(terms, 300 + 64 * std::cbrt(static_cast<double>(K)));
  }
}

TYPED_TEST(Syrk, TheSameBitsAgain) {
  const Case c{100, 5000, 1, 0};
  const std::vector<TypeParam> X = values_as<TypeParam>(random_values(c.K * c.m, 5, -1.0, 1.0));
  const std::vector<TypeParam> C(c.m * c.m, TypeParam{0});
  EXPECT_TRUE(same_bits(multiply(c, X, C), multiply(c, X, C)));
}

// A NaN or an infinity in column j reaches row j and column j of C, and nothing else.
TYPED_TEST(Syrk, NonFiniteValuesStayInTheirColumn) {
  for (const double bad : {double{unused}, std::numeric_limits<double>::infinity()}) {
    const Case c{30, 1000, 1, 0};
    std::vector<double> X = random_values(c.K * c.m, 6, 0.5, 1.0);
    X[999 * c.m + 17] = bad;
    const std::vector<TypeParam> C =
        multiply(c, values_as<TypeParam>(X), std::vector<TypeParam>(c.m * c.m, TypeParam{0}));
    for (std::size_t i = 0; i < c.m; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        EXPECT_EQ(std::isfinite(C[i * c.m + j]), i != 17 && j != 17) << i << ", " << j;
      }
    }
  }
}

}  // namespace
}  // namespace weft::test
