// Products of rows against sums by the definition, over lengths around those that are summed in
// float and those of a block.
#include "weft/codecs/slice_rows.hpp"

#include <gtest/gtest.h>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft::test {
namespace {

TEST(SliceRows, SmallProductsOfRows) {
  for (const std::size_t length : Sizes{1, 7, 2047, 2048, 2049, 4096 + 5}) {
    for (const auto& [a, b] : {std::pair<std::size_t, std::size_t>{1, 1}, {3, 5}, {9, 2}}) {
      const std::vector<float> A = random_floats(a * length, 1, -1, 1);
      const std::vector<float> B = random_floats(b * length, 2, -1, 1);
      const RowList rows = row_list(A, a, length);
      const RowList others = row_list(B, b, length);
      // sums of up to 2048 products in float, of values below 1
      const double tolerance = 2048 * 0x1p-24 * static_cast<double>(length);
      for (const bool same : {false, true}) {
        const RowList& right = same ? rows : others;
        std::vector<double> expected;
        for (const float* row : rows) {
          for (const float* other : right) {
            double sum = 0;
            for (std::size_t i = 0; i < length; ++i) sum += double{row[i]} * double{other[i]};
            expected.push_back(sum);
          }
        }
        EXPECT_TRUE(
            all_near(row_products(shared_device(), length, rows, right), expected, tolerance))
            << length;
      }
      // base + M rows, to rows that were picked
      const std::vector<float> M = random_floats(a * b, 3, -1, 1);
      std::vector<double> expected(a * length);
      std::vector<double> squares(a, 0.0);
      for (std::size_t i = 0; i < a * length; ++i) {
        expected[i] = double{A[i]};
        for (std::size_t r = 0; r < b; ++r) {
          expected[i] += double{M[i / length * b + r]} * double{B[r * length + i % length]};
        }
        squares[i / length] += expected[i] * expected[i];
      }
      std::vector<float> out(a * length + 2, 77.0f);
      combine_rows(shared_device(), length, rows, M, others, out.data() + 1);
      EXPECT_TRUE(all_near(std::span(out).subspan(1, a * length), expected, 16 * 0x1p-24 * 6));
      EXPECT_EQ(out.front(), 77.0f);
      EXPECT_EQ(out.back(), 77.0f);
      EXPECT_TRUE(all_near(combined_squares(shared_device(), length, rows, M, others), squares,
                           1e-5 * static_cast<double>(length)));
    }
  }
}

// Blocks of columns, and rows by number.
TEST(SliceRows, SeveralBlocks) {
  constexpr std::size_t length = (std::size_t{1} << 18) + 3000;
  const std::vector<float> A = random_floats(4 * length, 1, -1, 1);
  const RowList rows = picked(row_list(A, 4, length), Sizes{3, 1});
  const std::vector<float> one{2.0f, -1.0f};
  std::vector<float> out(length);
  combine_rows(shared_device(), length, {}, one, rows, out.data());
  double sum = 0;
  for (std::size_t i = 0; i < length; ++i) {
    ASSERT_EQ(out[i], 2 * A[3 * length + i] - A[length + i]);
    sum += double{A[3 * length + i]} * double{A[length + i]};
  }
  EXPECT_NEAR(row_products(shared_device(), length, rows, rows)[1], sum, 1e-2);
}

// Where rows lie and what they are added to, round the sizes of tiles and vectors; nothing beside
// is written.
TEST(SliceRows, SmallSumsOfRowsInPlace) {
  Device& device = shared_device();
  if (!device.limits().is_cpu) GTEST_SKIP() << "of CPU devices";
  constexpr std::size_t length = 61;
  const std::vector<float> A = random_floats(12 * length, 1, -1, 1);
  const std::vector<float> B = random_floats(9 * length, 2, -1, 1);
  const GuardedBuffer rows(device, std::span<const float>(A), "rows");
  const GuardedBuffer base(device, std::span<const float>(B), "base");
  for (const std::size_t count : Sizes{1, 3, 4, 5, 8, 9}) {
    for (const std::size_t width : Sizes{1, 15, 16, 17, 48, 49}) {
      const std::size_t terms = width % 5 + 1;
      const std::size_t first = width % 7;
      const std::vector<float> M = random_floats(count * terms, count, -1, 1);
      std::vector<cl_ulong> row_at;
      for (std::size_t j = 0; j < terms; ++j) row_at.push_back((5 * j + 2) % 12 * length);
      std::vector<cl_ulong> base_at;
      for (std::size_t i = 0; i < count; ++i) base_at.push_back((count - 1 - i) * length);
      for (const bool has_base : {false, true}) {
        GuardedBuffer out(device, count * width * sizeof(float), "sums");
        ops::RowSums(device, rows.buffer(), row_at, has_base ? &base.buffer() : nullptr, base_at, M,
                     count)
            .columns(first, width, out.buffer());
        std::vector<double> expected;
        for (std::size_t i = 0; i < count; ++i) {
          for (std::size_t p = first; p < first + width; ++p) {
            double sum = has_base ? double{B[base_at[i] + p]} : 0.0;
            for (std::size_t j = 0; j < terms; ++j) {
              sum += double{M[i * terms + j]} * double{A[row_at[j] + p]};
            }
            expected.push_back(sum);
          }
        }
        const auto found = out.values<float>();
        EXPECT_TRUE(all_near(found, expected, gamma(7, float_roundoff) * 6))
            << count << " " << width;
        EXPECT_TRUE(out.intact());
      }
    }
  }
}

TEST(SliceRows, SmallModesOfRows) {
  const Sizes sizes{3, 5, 40};
  const std::vector<float> A = random_floats(7 * 600, 1, -1, 1);
  const std::vector<float> U = random_floats(5 * 2, 2, -1, 1);    // [5][2]
  const std::vector<float> V = random_floats(50 * 40, 3, -1, 1);  // [50][40]
  const RowProduct products[] = {{1, ops::ModeProduct::project, 2, U},
                                 {2, ops::ModeProduct::expand, 50, V}};
  std::vector<float> out(7 * 3 * 2 * 50 + 2, 77.0f);
  multiply_modes(shared_device(), sizes, row_list(A, 7, 600), products, out.data() + 1);
  const std::vector<double> values(A.begin(), A.end());
  const std::vector<double> first =
      reference::mode_product(Sizes{7, 3, 5, 40}, 2, values, 2,
                              reference::transposed(5, 2, std::vector<double>(U.begin(), U.end())));
  const std::vector<double> expected = reference::mode_product(
      Sizes{7, 3, 2, 40}, 3, first, 50, std::vector<double>(V.begin(), V.end()));
  EXPECT_TRUE(all_near(std::span(out).subspan(1, 7 * 300), expected, 200 * 50 * 0x1p-24));
  EXPECT_EQ(out.front(), 77.0f);
  EXPECT_EQ(out.back(), 77.0f);
  // nothing to multiply: a copy
  std::vector<float> copy(7 * 600);
  multiply_modes(shared_device(), sizes, row_list(A, 7, 600), {}, copy.data());
  EXPECT_EQ(copy, A);
}

}  // namespace
}  // namespace weft::test
