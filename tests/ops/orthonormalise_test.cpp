// Orthonormal bases: orthonormality, span and order against an SVD in double, for bases of any
// rank, condition and magnitude.
#include "weft/ops/orthonormalise.hpp"

#include <gtest/gtest.h>

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
#include "weft/reference/gemm.hpp"
#include "weft/reference/gram.hpp"
#include "weft/reference/orthonormalise.hpp"

namespace weft::test {
namespace {

struct Basis {
  std::size_t rank = 0;
  std::vector<float> Q;  // n x count
};

Basis orthonormalise(std::size_t n, std::size_t count, std::span<const float> Y) {
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  // The padding is NaN, and must not get anywhere.
  const std::vector<float> panels = panels_of(Y, n, count, width, unused);
  GuardedBuffer y(device, std::span<const float>(panels), "Y");
  GuardedBuffer scratch(device, panels.size() * sizeof(float), "scratch");
  Basis basis;
  basis.rank = ops::orthonormalise(device, n, count, y.buffer(), scratch.buffer());
  const std::vector<float> values = y.values<float>();
  EXPECT_TRUE(y.intact());
  EXPECT_TRUE(scratch.intact());
  basis.Q = from_panels(values, n, count, width);
  // the columns that fill the last panel are zero now
  for (std::size_t c = count; c < ops::round_up(count, width); ++c) {
    for (std::size_t p = 0; p < n; ++p) {
      EXPECT_EQ(values[(c / width * n + p) * width + c % width], 0.0f);
    }
  }
  return basis;
}

double norm(std::span<const double> matrix, std::size_t columns, std::size_t j) {
  double square = 0;
  for (std::size_t at = j; at < matrix.size(); at += columns) square += matrix[at] * matrix[at];
  return std::sqrt(square);
}

// Singular values of the columns scaled to unit length below this part of the largest are dropped.
double floor_ratio(std::size_t count) {
  return static_cast<double>(count) * 0x1p-23;
}

// |Q^T Q - I| where the last round began with singular values in [1/2, sqrt 2]: each column is
// Y t + e with |e_p| <= gamma |Y_p| |t| (count products, and t rounded), |Y|_F <= sqrt(2 count),
// |t| <= 2; twice, for the two columns of an inner product.
double orthonormality_tolerance(std::size_t count) {
  const double columns = static_cast<double>(count);
  return 2 * gamma(columns + 2, float_roundoff) * std::sqrt(2 * columns) * 2;
}

// |y - Q Q^T y| / |y|: each round's rounding, gamma |Y|_F |t_r| sigma_r <= gamma sqrt(count) along
// each of count directions, and the directions that were dropped, sqrt(count) of the floor each.
double span_tolerance(std::size_t count) {
  const double columns = static_cast<double>(count);
  return 2 * columns * gamma(columns + 2, float_roundoff) +
         2 * std::sqrt(columns) * floor_ratio(count);
}

Basis expect_basis(std::size_t n, std::size_t count, std::span<const float> Y) {
  SCOPED_TRACE(testing::Message() << "n " << n << ", count " << count);
  Basis basis = orthonormalise(n, count, Y);
  const std::vector<double> Q = widened(basis.Q);

  // the rank is that of the columns as float holds them
  const std::vector<double> values = reference::orthonormalise(n, count, widened(Y)).values;
  std::size_t least = 0;
  std::size_t most = 0;
  for (const double value : values) {
    if (value > 2 * floor_ratio(count) * values[0]) ++least;
    if (value > 0.5 * floor_ratio(count) * values[0]) ++most;
  }
  EXPECT_GE(basis.rank, least);
  EXPECT_LE(basis.rank, most);

  const std::vector<double> products = reference::gram(n, count, Q, count, Q);
  std::vector<double> identity(count * count, 0.0);
  for (std::size_t j = 0; j < basis.rank; ++j) identity[j * count + j] = 1.0;
  EXPECT_TRUE(all_near(products, identity, [&](std::size_t i) {
    const bool dropped = i / count >= basis.rank || i % count >= basis.rank;
    return dropped ? 0.0 : orthonormality_tolerance(count);
  }));

  std::vector<double> rest = widened(Y);
  reference::project_out(n, Q, count, rest, count);
  for (std::size_t j = 0; j < count; ++j) {
    EXPECT_LE(norm(rest, count, j), span_tolerance(count) * norm(widened(Y), count, j))
        << "column " << j;
  }
  return basis;
}

std::vector<float> narrowed(std::span<const double> values) {
  return {values.begin(), values.end()};
}

TEST(Orthonormalise, SmallRandom) {
  EXPECT_EQ(expect_basis(9, 3, random_floats(9 * 3, 1, -1.0, 1.0)).rank, 3U);
}

TEST(Orthonormalise, StraddlesPanelsAndChunks) {
  for (const std::size_t n : Sizes{1, 2, 23, 24, 25, 100, 511, 513, 1025}) {
    for (const std::size_t count : Sizes{1, 2, 23, 24, 25, 49}) {
      expect_basis(n, count, random_floats(n * count, 2, -1.0, 1.0));
    }
  }
}

TEST(Orthonormalise, KeepsTheRankOfProducts) {
  const std::size_t n = 300;
  for (const std::size_t count : Sizes{5, 24, 30}) {
    for (const std::size_t rank : Sizes{1, 2, 4}) {
      const std::vector<double> A = random_values(n * rank, 3, -1.0, 1.0);
      const std::vector<double> B = random_values(rank * count, 4, -1.0, 1.0);
      std::vector<double> Y(n * count);
      reference::gemm(n, count, rank, 1.0, A, B, 0.0, Y);
      EXPECT_EQ(expect_basis(n, count, narrowed(Y)).rank, rank);
    }
  }
}

TEST(Orthonormalise, ZeroAndDuplicateColumns) {
  const std::size_t n = 120;
  const std::size_t count = 26;
  std::vector<float> Y = random_floats(n * count, 5, -1.0, 1.0);
  for (std::size_t p = 0; p < n; ++p) {
    float* row = &Y[p * count];
    row[0] = 0.0f;
    row[7] = row[3];
    row[25] = row[3];
    row[12] = -row[11];
    row[20] = 8.0f * row[11];
    row[24] = 0.0f;
  }
  EXPECT_EQ(expect_basis(n, count, Y).rank, count - 6);
  // nothing but zeros, and nothing but ones
  EXPECT_EQ(expect_basis(n, count, std::vector<float>(n * count, 0.0f)).rank, 0U);
  EXPECT_EQ(expect_basis(n, count, std::vector<float>(n * count, 1.0f)).rank, 1U);
  EXPECT_EQ(expect_basis(1, 1, std::vector<float>{-3.0f}).rank, 1U);
}

TEST(Orthonormalise, ConditionNumbersTo1e12) {
  const std::size_t n = 200;
  const std::size_t count = 24;
  for (const double condition : {1e2, 1e4, 1e6, 1e8, 1e12}) {
    SCOPED_TRACE(condition);
    std::vector<double> values(count);
    for (std::size_t i = 0; i < count; ++i) {
      values[i] = std::pow(condition, -static_cast<double>(i) / (count - 1.0));
    }
    expect_basis(n, count, narrowed(matrix_with_singular_values(n, count, values, 6)));
  }
  // a cluster at the top and one at the bottom
  std::vector<double> clustered(count, 1.0);
  std::fill(clustered.begin() + 12, clustered.end(), 1e-5);
  EXPECT_EQ(
      expect_basis(n, count, narrowed(matrix_with_singular_values(n, count, clustered, 7))).rank,
      count);
}

TEST(Orthonormalise, ColumnsOfAnyMagnitude) {
  const std::size_t n = 150;
  const std::size_t count = 25;
  const std::vector<float> base = random_floats(n * count, 8, -1.0, 1.0);
  // 1e-30 to 1e30 side by side, then all alike, down to subnormals and up to the largest floats
  std::vector<float> graded = base;
  for (std::size_t i = 0; i < graded.size(); ++i) {
    graded[i] *= std::pow(10.0f, 60.0f * static_cast<float>(i % count) / 24 - 30);
  }
  EXPECT_EQ(expect_basis(n, count, graded).rank, count);
  for (const float scale : {1e-30f, 1e30f, 1e-37f, 1e-41f, 3e38f}) {
    SCOPED_TRACE(scale);
    std::vector<float> scaled = base;
    for (float& value : scaled) value *= scale;
    EXPECT_EQ(expect_basis(n, count, scaled).rank, count);
  }
}

// Subnormal and nearly dependent: the factors that make columns orthonormal leave the range of
// float twice over.
TEST(Orthonormalise, SubnormalAndNearlyDependent) {
  std::vector<float> Y(40 * 2);
  for (std::size_t p = 0; p < 40; ++p) {
    Y[2 * p] = 1e-38f * static_cast<float>(1 + p % 3);
    Y[2 * p + 1] = Y[2 * p] + (p == 17 ? 0x1p-140f : 0.0f);
  }
  EXPECT_EQ(expect_basis(40, 2, Y).rank, 2U);
}

// By descending extent: along the left singular vectors, where these are well apart.
TEST(Orthonormalise, ColumnsAreSortedByExtent) {
  const std::size_t n = 90;
  const std::size_t count = 4;
  // two thirds of each column is common to all, so that unit columns have distinct extents
  std::vector<float> Y = random_floats(n * count, 9, -1.0, 1.0);
  for (std::size_t p = 0; p < n; ++p) {
    for (std::size_t j = 1; j < count; ++j) {
      Y[p * count + j] = Y[p * count] + std::pow(0.1f, static_cast<float>(j)) * Y[p * count + j];
    }
  }
  const Basis basis = expect_basis(n, count, Y);
  const reference::ColumnSpace expected = reference::orthonormalise(n, count, widened(Y));
  ASSERT_EQ(basis.rank, count);
  for (std::size_t j = 0; j < count; ++j) {
    double cosine = 0;
    for (std::size_t p = 0; p < n; ++p) {
      cosine += double{basis.Q[p * count + j]} * expected.Q[p * count + j];
    }
    // the sine is at most the perturbation over the gap to the neighbours (Wedin)
    const double value = expected.values[j];
    double gap = value;
    if (j > 0) gap = std::min(gap, expected.values[j - 1] - value);
    if (j + 1 < count) gap = std::min(gap, value - expected.values[j + 1]);
    const double sine = span_tolerance(count) / gap;
    ASSERT_LT(sine, 0.2) << "the case is badly chosen";
    EXPECT_GE(std::abs(cosine), std::sqrt(1 - sine * sine) - orthonormality_tolerance(count));
  }
}

TEST(Orthonormalise, TheSameBitsTwice) {
  const std::vector<float> Y = random_floats(700 * 30, 10, -1.0, 1.0);
  EXPECT_TRUE(same_bits(orthonormalise(700, 30, Y).Q, orthonormalise(700, 30, Y).Q));
}

TEST(Orthonormalise, NonFiniteColumnsAreNamed) {
  Device& device = shared_device();
  for (const float bad : {unused, std::numeric_limits<float>::infinity()}) {
    std::vector<float> Y = random_floats(50 * 3, 11, -1.0, 1.0);
    Y[20 * 3 + 2] = bad;
    expect_error(ErrorKind::runtime, {"column 2"}, [&] { orthonormalise(50, 3, Y); });
  }
  device.finish();
}

// Y - Q (Q^T Y) to the rounding of its coefficients (u each) and of the product (q_count + 2).
void expect_projection(std::size_t n, std::size_t q_count, std::size_t count, float scale) {
  SCOPED_TRACE(testing::Message() << "n " << n << ", " << q_count << " and " << count
                                  << " columns, scale " << scale);
  Device& device = shared_device();
  const std::size_t width = ops::panel_width(device);
  const std::vector<float> Q = narrowed(random_orthonormal(n, q_count, 12));
  std::vector<float> Y = random_floats(n * count, 13, -1.0, 1.0);
  for (float& value : Y) value *= scale;
  const std::vector<float> q_panels = panels_of(Q, n, q_count, width, unused);
  const std::vector<float> y_panels = panels_of(Y, n, count, width, 0.0f);
  GuardedBuffer q(device, std::span<const float>(q_panels), "Q");
  GuardedBuffer y(device, std::span<const float>(y_panels), "Y");
  ops::project_out(device, n, q.buffer(), q_count, y.buffer(), count);
  const std::vector<float> actual = from_panels(y.values<float>(), n, count, width);
  EXPECT_TRUE(y.intact());
  EXPECT_TRUE(same_bits(q.values<float>(), q_panels));

  std::vector<double> expected = widened(Y);
  reference::project_out(n, widened(Q), q_count, expected, count);
  // |y| + |Q| |Q^T Y|
  std::vector<double> coefficients = reference::gram(n, q_count, widened(Q), count, widened(Y));
  for (double& value : coefficients) value = std::abs(value);
  std::vector<double> size = magnitudes(Y);
  reference::gemm(n, count, q_count, 1.0, magnitudes(Q), coefficients, 1.0, size);
  const double unit = gamma(static_cast<double>(q_count) + 4, float_roundoff);
  EXPECT_TRUE(all_near(actual, expected, [&](std::size_t i) { return unit * size[i]; }));
}

TEST(ProjectOut, Small) {
  expect_projection(11, 3, 2, 1.0f);
}

TEST(ProjectOut, StraddlesPanels) {
  for (const std::size_t n : Sizes{49, 513}) {
    for (const std::size_t q_count : Sizes{1, 23, 24, 25, 49}) {
      for (const std::size_t count : Sizes{1, 23, 24, 25})
        expect_projection(n, q_count, count, 1.0f);
    }
  }
}

TEST(ProjectOut, KeepsMagnitudes) {
  for (const float scale : {1e-30f, 1e30f}) expect_projection(100, 10, 5, scale);
}

TEST(ProjectOut, OfNothingChangesNothing) {
  Device& device = shared_device();
  const std::vector<float> Y = random_floats(24 * 10, 14, -1.0, 1.0);
  Buffer q(device, 24 * sizeof(float), "Q");
  GuardedBuffer y(device, std::span<const float>(Y), "Y");
  ops::project_out(device, 10, q, 0, y.buffer(), 24);
  EXPECT_TRUE(same_bits(y.values<float>(), Y));
}

// Columns of doubles: a basis orthonormal to their rounding, of columns whose condition is 1e5.
TEST(Orthonormalise, SmallBasesInDouble) {
  Device& device = shared_device();
  for (const std::size_t count : Sizes{1, 5, 12, 13, 30}) {
    const std::size_t n = 40;
    std::vector<double> values(count);
    for (std::size_t j = 0; j < count; ++j) {
      values[j] = std::pow(10.0, -5.0 * static_cast<double>(j) / static_cast<double>(count));
    }
    const std::vector<double> Y = matrix_with_singular_values(n, count, values, 3);
    const std::size_t width = ops::panel_width(device, Arithmetic::f64);
    std::vector<double> panels(ops::round_up(count, width) * n, 0.0);
    for (std::size_t p = 0; p < n; ++p) {
      for (std::size_t j = 0; j < count; ++j) {
        panels[(j / width * n + p) * width + j % width] = Y[p * count + j];
      }
    }
    GuardedBuffer y(device, std::span<const double>(panels), "Y");
    GuardedBuffer scratch(device, panels.size() * sizeof(double), "scratch");
    ASSERT_EQ(ops::orthonormalise(device, n, count, y.buffer(), scratch.buffer(), Arithmetic::f64),
              count);
    EXPECT_TRUE(y.intact());
    EXPECT_TRUE(scratch.intact());
    const std::vector<double> stored = y.values<double>();
    std::vector<double> Q(n * count);
    for (std::size_t p = 0; p < n; ++p) {
      for (std::size_t j = 0; j < count; ++j) {
        Q[p * count + j] = stored[(j / width * n + p) * width + j % width];
      }
    }
    const std::vector<double> products = reference::gram(n, count, Q, count, Q);
    const double columns = static_cast<double>(count);
    const double tolerance =
        4 * gamma(columns + static_cast<double>(n), double_roundoff) * std::sqrt(2 * columns);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < count; ++j) {
        EXPECT_NEAR(products[i * count + j], i == j ? 1.0 : 0.0, tolerance) << count;
      }
    }
    std::vector<double> rest = Y;
    reference::project_out(n, Q, count, rest, count);
    // the first round's rounding, times the condition
    for (const double value : rest) EXPECT_NEAR(value, 0.0, 1e5 * tolerance);
  }
}

// What only rounding is left of is no direction.
TEST(Orthonormalise, DropsWhatAProjectionTookAway) {
  Device& device = shared_device();
  const std::size_t n = 50, count = 5;
  std::vector<float> Y(n * count, 0.0f);
  for (std::size_t j = 0; j < count; ++j) Y[j * count + j] = j < 3 ? 0.9f : 1e-7f;
  const std::size_t width = ops::panel_width(device);
  const std::vector<float> panels = panels_of(Y, n, count, width, 0.0f);
  GuardedBuffer y(device, std::span<const float>(panels), "Y");
  GuardedBuffer scratch(device, panels.size() * sizeof(float), "scratch");
  EXPECT_EQ(
      ops::orthonormalise(device, n, count, y.buffer(), scratch.buffer(), Arithmetic::f32, 0.5),
      3U);
  const std::vector<float> Q = from_panels(y.values<float>(), n, count, width);
  for (std::size_t p = 0; p < n; ++p) {
    EXPECT_EQ(Q[p * count + 3], 0.0f);
    EXPECT_EQ(Q[p * count + 4], 0.0f);
  }
}

}  // namespace
}  // namespace weft::test
