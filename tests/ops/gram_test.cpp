// Inner products against the reference, with double and with pairs of floats, at sizes about the
// blocks of 4 x 8 columns, the panel (24) and the chunk (512 rows, or a 64th).
#include "weft/ops/gram.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/gram.hpp"

namespace weft::test {
namespace {

using ops::GramSums;

// n x count row-major as columns on the device; their padding is NaN, which must not get anywhere.
class GuardedColumns {
 public:
  GuardedColumns(std::span<const float> matrix, std::size_t n, std::size_t count, bool packed)
      : buffer_(shared_device(), std::span<const float>(stored(matrix, n, count, packed)),
                "columns"),
        columns(packed ? ops::packed_columns(shared_device(), buffer_.buffer(), n, count)
                       : ops::row_major_columns(shared_device(), buffer_.buffer(), leading(count),
                                                count)) {}
  bool intact() { return static_cast<bool>(buffer_.intact()); }

 private:
  static std::size_t leading(std::size_t count) {
    return ops::round_up(count, ops::panel_width(shared_device()));
  }
  static std::vector<float> stored(std::span<const float> matrix, std::size_t n, std::size_t count,
                                   bool packed) {
    if (packed) return panels_of(matrix, n, count, ops::panel_width(shared_device()), unused);
    std::vector<float> rows = with_leading(matrix, n, count, leading(count));
    rows.resize(n * leading(count), unused);
    return rows;
  }

  GuardedBuffer buffer_;

 public:
  ops::Columns columns;
};

// |error| / sum |x z| of a sum of n products; see ops/gram.hpp. The reference's own error is in it.
double tolerance(std::size_t n, GramSums sums) {
  const double in_double = 2 * gamma(static_cast<double>(n), double_roundoff);
  if (sums == GramSums::best && shared_device().limits().has_fp64) return in_double;
  const double chunk = static_cast<double>(std::max<std::size_t>(512, ops::ceil_div(n, 64)));
  const double pairs = gamma(2 * std::min(chunk, static_cast<double>(n)), float_roundoff);
  return in_double + pairs * pairs;
}

void expect_gram(std::size_t n, std::size_t count_x, std::size_t count_z, bool packed,
                 std::span<const float> X, std::span<const float> Z, GramSums sums) {
  SCOPED_TRACE(testing::Message() << "n " << n << ", " << count_x << " x " << count_z
                                  << (packed ? ", packed" : ", row-major")
                                  << (sums == GramSums::best ? "" : ", float pairs"));
  GuardedColumns x(X, n, count_x, packed);
  GuardedColumns z(Z, n, count_z, packed);
  const std::vector<double> actual = ops::gram(shared_device(), n, x.columns, z.columns, sums);
  const std::vector<double> expected = reference::gram(n, count_x, widened(X), count_z, widened(Z));
  const std::vector<double> size =
      reference::gram(n, count_x, magnitudes(X), count_z, magnitudes(Z));
  EXPECT_TRUE(
      all_near(actual, expected, [&](std::size_t i) { return tolerance(n, sums) * size[i]; }));
  EXPECT_TRUE(x.intact());
  EXPECT_TRUE(z.intact());
  // the same bits again
  EXPECT_TRUE(same_bits(ops::gram(shared_device(), n, x.columns, z.columns, sums), actual));
}

class Gram : public testing::TestWithParam<GramSums> {};

INSTANTIATE_TEST_SUITE_P(Sums, Gram, testing::Values(GramSums::best, GramSums::float_pairs),
                         [](const auto& info) {
                           return info.param == GramSums::best ? std::string("Best")
                                                               : std::string("FloatPairs");
                         });

TEST_P(Gram, SmallOfTwoSets) {
  const std::vector<float> X = random_floats(7 * 5, 1, -1.0, 1.0);
  const std::vector<float> Z = random_floats(7 * 26, 2, -1.0, 1.0);
  for (const bool packed : {true, false}) expect_gram(7, 5, 26, packed, X, Z, GetParam());
}

TEST_P(Gram, StraddlesBlocksOfColumns) {
  for (const std::size_t count_x : Sizes{1, 3, 4, 5, 23, 24, 25, 49}) {
    for (const std::size_t count_z : Sizes{1, 7, 8, 9, 23, 24, 25, 50}) {
      const std::vector<float> X = random_floats(13 * count_x, 3, -1.0, 1.0);
      const std::vector<float> Z = random_floats(13 * count_z, 4, -1.0, 1.0);
      for (const bool packed : {true, false}) {
        expect_gram(13, count_x, count_z, packed, X, Z, GetParam());
      }
    }
  }
}

TEST_P(Gram, StraddlesChunks) {
  for (const std::size_t n : Sizes{1, 2, 511, 512, 513, 1024, 1025, 32768, 32769, 40000}) {
    const std::vector<float> X = random_floats(n * 5, 5, -1.0, 1.0);
    const std::vector<float> Z = random_floats(n * 3, 6, -1.0, 1.0);
    expect_gram(n, 5, 3, true, X, Z, GetParam());
    expect_gram(n, 5, 5, false, X, X, GetParam());
  }
}

// Products that cancel but for a part in 2^30: what is left would be noise in float.
TEST_P(Gram, KeepsWhatCancellationLeaves) {
  const std::size_t n = 1000;
  std::vector<float> X = random_floats(n, 7, 0.5, 1.0);
  std::vector<float> Z = random_floats(n, 8, 0.5, 1.0);
  for (std::size_t p = 0; p < n / 2; ++p) {
    X[n / 2 + p] = X[p];
    Z[n / 2 + p] = -Z[p];
  }
  Z[n - 1] += 0x1p-20f;
  expect_gram(n, 1, 1, true, X, Z, GetParam());
  const std::vector<double> expected = reference::gram(n, 1, widened(X), 1, widened(Z));
  EXPECT_GT(std::abs(expected[0]), 0x1p-22);
}

// Each inner product is accurate for its own pair of columns, whatever the others' magnitudes.
TEST_P(Gram, ColumnsOfAnyMagnitude) {
  const std::size_t n = 700;
  const std::size_t count = 26;
  std::vector<float> X = random_floats(n * count, 9, -1.0, 1.0);
  for (std::size_t j = 0; j < count; ++j) {
    // 1e-30 to 1e30, and one column of zeros
    const float scale = j == 13 ? 0.0f : std::pow(10.0f, 60.0f * static_cast<float>(j) / 25 - 30);
    for (std::size_t p = 0; p < n; ++p) X[p * count + j] *= scale;
  }
  expect_gram(n, count, count, true, X, X, GetParam());
  // within a column too
  std::vector<float> graded = random_floats(n * 2, 10, -1.0, 1.0);
  for (std::size_t p = 0; p < n; ++p) {
    const float scale = std::pow(10.0f, -30.0f * static_cast<float>(p) / static_cast<float>(n));
    graded[p * 2] *= scale;
    graded[p * 2 + 1] /= scale;
  }
  expect_gram(n, 2, 2, false, graded, graded, GetParam());
}

TEST_P(Gram, SubnormalAndLargestValues) {
  const std::vector<float> X{0x1p-149f, 0x1.fffffep127f, 0x1p-140f, 0x1.8p127f, 0.0f, -0x1p126f};
  expect_gram(3, 2, 2, true, X, X, GetParam());
}

TEST_P(Gram, IntegersAreExact) {
  const std::size_t n = 1500;
  const std::vector<float> X = random_integers(n * 9, 11, 100);
  GuardedColumns x(X, n, 9, true);
  EXPECT_TRUE(all_equal(ops::gram(shared_device(), n, x.columns, x.columns, GetParam()),
                        reference::gram(n, 9, widened(X), 9, widened(X))));
}

TEST_P(Gram, NonFiniteValuesShow) {
  const std::size_t n = 600;
  std::vector<float> X = random_floats(n * 3, 12, 0.5, 1.0);
  X[599 * 3 + 1] = unused;
  GuardedColumns x(X, n, 3, true);
  const std::vector<double> G = ops::gram(shared_device(), n, x.columns, x.columns, GetParam());
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) EXPECT_EQ(std::isfinite(G[i * 3 + j]), i != 1 && j != 1);
  }
}

// 10^7 equal terms, which are rounded alike: errors add up as they can. The columns are one row,
// read again and again.
TEST_P(Gram, LongSums) {
  const std::size_t n = 10'000'000;
  const std::vector<float> X{0.1f, 0.3f};
  GuardedColumns x(X, 1, 2, true);
  x.columns.row = 0;
  const std::vector<double> G = ops::gram(shared_device(), n, x.columns, x.columns, GetParam());
  const bool in_double = GetParam() == GramSums::best && shared_device().limits().has_fp64;
  const double chunk = static_cast<double>(n) / 64;
  const double bound = in_double ? (577 + chunk / 512 + 2) * double_roundoff
                                 : std::pow(gamma(2 * chunk, float_roundoff), 2);
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t j = 0; j < 2; ++j) {
      const double expected = double{X[i]} * double{X[j]} * static_cast<double>(n);
      EXPECT_NEAR(G[i * 2 + j], expected, bound * expected);
    }
  }
}

TEST_P(Gram, NoColumnsGiveNothing) {
  const std::vector<float> X(24, 1.0f);
  GuardedColumns x(X, 1, 24, true);
  ops::Columns none = x.columns;
  none.count = 0;
  EXPECT_TRUE(ops::gram(shared_device(), 1, x.columns, none, GetParam()).empty());
}

}  // namespace
}  // namespace weft::test
