#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/process.hpp"

namespace weft::test {
namespace {

TEST(AllNear, NamesTheFirstDifference) {
  const std::vector<float> actual{1.0F, 2.0F, 3.5F, 9.0F};
  const std::vector<double> expected{1.0, 2.25, 3.5, 4.0};
  EXPECT_TRUE(all_near(actual, actual, 0.0));
  const testing::AssertionResult result = all_near(actual, expected, 0.125);
  EXPECT_FALSE(result);
  EXPECT_STREQ(result.message(),
               "2 of 4 values differ, first at index 1: 2 where 2.25 is expected, difference 0.25, "
               "tolerance 0.125");
  EXPECT_FALSE(all_near(actual, std::vector<double>{1.0}, 1.0));
}

TEST(AllNear, NanEqualsNothingAndInfinityItself) {
  const double nan = std::nan("");
  const double inf = std::numeric_limits<double>::infinity();
  const std::vector<double> zero{0.0};
  EXPECT_FALSE(all_near(std::vector<double>{nan}, std::vector<double>{nan}, 1.0));
  EXPECT_FALSE(all_near(std::vector<double>{nan}, zero, 1.0));
  EXPECT_FALSE(all_near(zero, std::vector<double>{nan}, 1.0));
  EXPECT_FALSE(all_near(zero, std::vector<double>{1.0}, nan));
  EXPECT_TRUE(all_near(std::vector<double>{inf}, std::vector<double>{inf}, 0.0));
  EXPECT_FALSE(all_near(std::vector<double>{inf}, std::vector<double>{-inf}, 1.0));
  EXPECT_FALSE(all_near(std::vector<double>{inf}, zero, 1e300));
}

TEST(Generators, OrthonormalColumnsAndSingularValues) {
  constexpr std::size_t rows = 23;
  constexpr std::size_t columns = 9;
  const std::vector<double> q = random_orthonormal(rows, columns, 5);
  for (std::size_t a = 0; a < columns; ++a) {
    for (std::size_t b = 0; b < columns; ++b) {
      double dot = 0;
      for (std::size_t r = 0; r < rows; ++r) dot += q[r * columns + a] * q[r * columns + b];
      EXPECT_NEAR(dot, a == b ? 1.0 : 0.0, 4.0 * gamma(rows + columns, double_roundoff));
    }
  }
  // The squared Frobenius norm is the sum of the squared singular values.
  const std::vector<double> values{3.0, 1.0, 0.25};
  const std::vector<double> matrix = matrix_with_singular_values(rows, columns, values, 6);
  double square = 0;
  for (const double value : matrix) square += value * value;
  EXPECT_NEAR(square, 9.0 + 1.0 + 0.0625, 10.0 * 8.0 * gamma(rows * columns, double_roundoff));
  EXPECT_TRUE(all_equal(matrix, matrix_with_singular_values(rows, columns, values, 6)));
}

TEST(Generators, ValuesSurviveEachType) {
  const std::vector<double> values{0.0, 1.0, 51.0 / 255.0};
  EXPECT_TRUE(all_near(decode_values(encode_values(values, DType::u8), DType::u8), values, 0.0));
  const std::vector<double> dyadic{0.0, -0.375, 1024.0};
  for (const DType dtype : {DType::f16, DType::f32}) {
    EXPECT_TRUE(all_equal(decode_values(encode_values(dyadic, dtype), dtype), dyadic));
  }
}

TEST(MemoryBtf, SourceToSink) {
  const auto source = random_source({2, 3, 4, 5, 3}, DType::f16, 1);
  MemorySink sink(source->info());
  std::vector<std::byte> tile(4 * source->info().image_bytes());
  source->read(0, 4, tile);
  sink.write(0, 4, tile);
  EXPECT_THROW(sink.finish(), std::logic_error);
  EXPECT_THROW(sink.write(5, 1, std::span(tile).first(source->info().image_bytes())),
               std::logic_error);
  tile.resize(2 * source->info().image_bytes());
  source->read(4, 2, tile);
  sink.write(4, 2, tile);
  sink.finish();
  EXPECT_TRUE(all_equal(sink.values(), decode_values(source->bytes(), DType::f16)));
  EXPECT_EQ(source->images_read(), 6U);
  EXPECT_EQ(source->largest_read(), 4U);
  EXPECT_THROW(source->read(6, 1, tile), std::logic_error);
}

TEST(Process, StatusOutputAndEnvironment) {
  const ProcessResult result =
      run_process({"/bin/sh", "-c", "echo $GREETING; echo oops >&2; exit 7"}, {{"GREETING", "hi"}});
  EXPECT_EQ(result.status, 7);
  EXPECT_EQ(result.out, "hi\n");
  EXPECT_EQ(result.err, "oops\n");
  EXPECT_FALSE(result.timed_out);
}

TEST(Process, IsKilledWhenItTakesTooLong) {
  const ProcessResult result = run_process({"/bin/sleep", "60"}, {}, 0.05);
  EXPECT_TRUE(result.timed_out);
  EXPECT_EQ(result.status, 128 + 9);
}

}  // namespace
}  // namespace weft::test
