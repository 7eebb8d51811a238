// Squared norms and conversions of reals, in both arithmetics, about the chunk and the vector.
#include "weft/ops/sum_squares.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/reals.hpp"
#include "weft/reference/gram.hpp"

namespace weft::test {
namespace {

class Reals : public testing::TestWithParam<Arithmetic> {
 protected:
  Arithmetic arithmetic() const { return GetParam(); }
  double unit() const { return arithmetic() == Arithmetic::f32 ? float_roundoff : double_roundoff; }
  // Values as the arithmetic holds them.
  std::vector<double> held(std::vector<double> values) const {
    if (arithmetic() == Arithmetic::f32) {
      for (double& value : values) value = static_cast<double>(static_cast<float>(value));
    }
    return values;
  }
  Buffer upload(std::span<const double> values) const {
    return ops::real_buffer(shared_device(), values, arithmetic(), "values");
  }
  // n x count against the reference, for all lengths n and counts.
  void expect_inner_products(const Sizes& lengths, const Sizes& counts) const {
    const std::size_t width = ops::panel_width(shared_device(), arithmetic());
    for (const std::size_t n : lengths) {
      for (const std::size_t count : counts) {
        const std::vector<double> X = held(random_values(n * count, 4, -1.0, 1.0));
        const std::size_t leading = ops::round_up(count, width);
        std::vector<double> padded(n * leading, 0.0);
        for (std::size_t p = 0; p < n; ++p) {
          for (std::size_t j = 0; j < count; ++j) padded[p * leading + j] = X[p * count + j];
        }
        const Buffer buffer = upload(padded);
        const ops::Columns columns =
            ops::row_major_columns(shared_device(), buffer, leading, count, arithmetic());
        const std::vector<double> expected = reference::gram(n, count, X, count, X);
        EXPECT_TRUE(
            all_near(ops::gram(shared_device(), n, columns, columns), expected,
                     2 * gamma(static_cast<double>(n), double_roundoff) * static_cast<double>(n)))
            << n << " x " << count;
        if (count > width) {
          ops::Columns last = columns;
          last.offset = width;
          last.count = count - width;
          const std::vector<double> part = ops::gram(shared_device(), n, last, columns);
          EXPECT_TRUE(all_near(
              part, std::span(expected).subspan(width * count),
              2 * gamma(static_cast<double>(n), double_roundoff) * static_cast<double>(n)));
        }
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Arithmetics, Reals, testing::Values(Arithmetic::f32, Arithmetic::f64),
                         [](const auto& info) {
                           return info.param == Arithmetic::f32 ? std::string("F32")
                                                                : std::string("F64");
                         });

TEST_P(Reals, SmallSumsOfSquares) {
  for (const std::size_t count : Sizes{1, 7, 8, 9, 2047, 2048, 2049}) {
    const std::vector<double> values = held(random_values(count, 1, -1.0, 1.0));
    double expected = 0;
    for (const double value : values) expected += value * value;
    // eight sums of 256 floats each where there is no double
    const double roundoff = shared_device().limits().has_fp64 ? double_roundoff : float_roundoff;
    EXPECT_NEAR(ops::sum_squares(shared_device(), count, upload(values), arithmetic()), expected,
                gamma(static_cast<double>(count), roundoff) * expected)
        << count;
  }
  EXPECT_EQ(ops::sum_squares(shared_device(), 0, upload({}), arithmetic()), 0.0);
}

TEST_P(Reals, LongSumsOfSquares) {
  const std::size_t count = 100001;
  const std::vector<double> values = held(random_values(count, 2, 0.5, 1.0));
  double expected = 0;
  for (const double value : values) expected += value * value;
  EXPECT_NEAR(ops::sum_squares(shared_device(), count, upload(values), arithmetic()), expected,
              2 * gamma(static_cast<double>(count), double_roundoff) * expected);
}

TEST_P(Reals, AreReadWithoutTheirPadding) {
  const std::size_t rows = 5, columns = 3, leading = 7;
  std::vector<double> values = held(random_values(rows * leading, 3, -1.0, 1.0));
  const Buffer buffer = upload(values);
  std::vector<double> doubles(rows * columns);
  std::vector<float> floats(rows * columns);
  ops::read_reals(shared_device(), buffer, arithmetic(), rows, columns, leading, 0x1p-140,
                  std::span<double>(doubles));
  ops::read_reals(shared_device(), buffer, arithmetic(), rows, columns, leading, 4.0,
                  std::span<float>(floats));
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      EXPECT_EQ(doubles[i * columns + j], values[i * leading + j] * 0x1p-140);
      EXPECT_EQ(floats[i * columns + j], static_cast<float>(values[i * leading + j] * 4));
    }
  }
}

// Inner products in double of columns of either arithmetic, beyond one block of columns, and those
// of a part of a matrix.
TEST_P(Reals, SmallInnerProducts) {
  expect_inner_products({7}, {13});
}

TEST_P(Reals, InnerProducts) {
  expect_inner_products({1, 13, 513}, {1, 3, 4, 5, 11, 12, 13, 25, 241});
}

}  // namespace
}  // namespace weft::test
