// Errors of decoded tiles, at sizes about the vector (8 values) and the chunk (2048 values).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/tiles.hpp"
#include "support/matchers.hpp"
#include "weft/reference/tile.hpp"

namespace weft::test {
namespace {

constexpr std::size_t chunk = 2048;

ErrorSums errors(const Tile& tile, std::span<const float> decoded, float scale) {
  GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer approximation(shared_device(), decoded, "decoded");
  const ErrorSums sums =
      ops::error_sums(shared_device(), tile.shape, raw.buffer(), approximation.buffer(), scale);
  EXPECT_TRUE(raw.intact());
  EXPECT_TRUE(approximation.intact());
  // the same bits again
  const ErrorSums again =
      ops::error_sums(shared_device(), tile.shape, raw.buffer(), approximation.buffer(), scale);
  EXPECT_TRUE(same_bits(std::vector<double>{again.square_difference, again.max_difference},
                        {sums.square_difference, sums.max_difference}));
  return sums;
}

void expect_errors(const Tile& tile, std::span<const float> decoded, float scale) {
  SCOPED_TRACE(testing::Message() << tile << ", scale " << scale);
  const ErrorSums actual = errors(tile, decoded, scale);
  const std::vector<double> approximation = widened(decoded);
  const ErrorSums expected = reference::error_sums(tile.values, approximation);
  EXPECT_EQ(actual.count, tile.shape.values());

  // Each value has an error e of its own: u |T| for 8-bit values, u |T - T'| for differences. A
  // chunk's squares are added in chunk / 8 steps, 7 last values and 3 sums of lanes.
  const double of_value = tile.shape.dtype == DType::u8 ? float_roundoff : 0.0;
  const double of_sum = gamma(chunk / 8.0 + 10, float_roundoff);
  double difference_tolerance = 0;
  double reference_tolerance = 0;
  double largest_error = 0;
  for (std::size_t i = 0; i < tile.values.size(); ++i) {
    const double value = std::abs(tile.values[i]);
    const double difference = std::abs(tile.values[i] - approximation[i]);
    const double e = of_value * value + float_roundoff * (difference + of_value * value);
    difference_tolerance +=
        2 * difference * e + e * e + of_sum * (difference + e) * (difference + e);
    reference_tolerance += (2 * of_value + of_sum * (1 + 3 * of_value)) * value * value;
    largest_error = std::max(largest_error, e);
  }
  EXPECT_NEAR(actual.square_difference, expected.square_difference, difference_tolerance);
  EXPECT_NEAR(actual.square_reference, expected.square_reference, reference_tolerance);
  EXPECT_NEAR(actual.max_difference, expected.max_difference, largest_error);
  EXPECT_NEAR(actual.max_reference, expected.max_reference, of_value * expected.max_reference);
}

// Off by about `size`.
std::vector<float> approximation_of(const Tile& tile, double size) {
  std::vector<float> decoded(tile.values.begin(), tile.values.end());
  const std::vector<float> errors = random_floats(decoded.size(), 9, -size, size);
  for (std::size_t i = 0; i < decoded.size(); ++i) decoded[i] += errors[i];
  return decoded;
}

TEST(ErrorSums, SmallOfEveryType) {
  for (const DType dtype : raw_types) {
    const Tile tile = random_tile(1, 13, 3, dtype, 1);
    expect_errors(tile, approximation_of(tile, 0.1), 1.0f);
  }
}

TEST(ErrorSums, StraddlesVectorsAndChunks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t texels :
         Sizes{1, 7, 8, 9, chunk - 1, chunk, chunk + 1, 2 * chunk, 5000}) {
      const Tile tile = random_tile(1, texels, 1, dtype, 2);
      expect_errors(tile, approximation_of(tile, 0.1), 1.0f);
      expect_errors(tile, approximation_of(tile, 1e-4), 0.5f);
    }
    const Tile tile = random_tile(3, 700, 3, dtype, 3);
    expect_errors(tile, approximation_of(tile, 1.0), 4.0f);
  }
}

TEST(ErrorSums, NothingIsLostNorFoundOfAnExactReconstruction) {
  for (const DType dtype : {DType::f16, DType::f32}) {
    const Tile tile = random_tile(1, 5000, 1, dtype, 4);
    const ErrorSums sums = errors(tile, approximation_of(tile, 0.0), 1.0f);
    EXPECT_EQ(sums.square_difference, 0.0);
    EXPECT_EQ(sums.max_difference, 0.0);
  }
}

TEST(ErrorSums, ScalesKeepSquaresInRange) {
  for (const double size : {1e30, 1e-30, 1e38}) {
    const Tile tile = tile_of(1, 3000, 1, DType::f32, random_values(3000, 5, -size, size));
    int exponent = 0;
    std::frexp(size, &exponent);
    expect_errors(tile, approximation_of(tile, 0.01 * size), std::ldexp(1.0f, -exponent));
  }
}

// Where the largest error and the largest value are does not matter.
TEST(ErrorSums, MaximaAreFoundEverywhere) {
  for (const std::size_t at : Sizes{0, 7, 8, chunk - 1, chunk, 4999}) {
    std::vector<double> values(5000, 0.25);
    values[at] = -3.0;
    const Tile tile = tile_of(1, 5000, 1, DType::f32, values);
    std::vector<float> decoded(5000, 0.25f);
    expect_errors(tile, decoded, 1.0f);
    EXPECT_EQ(errors(tile, decoded, 1.0f).max_difference, 3.25);
  }
}

// A NaN in the reconstruction must not pass for a small error, wherever it is and whatever follows.
TEST(ErrorSums, NonFiniteReconstructionsShow) {
  const Tile tile = random_tile(1, 5000, 1, DType::f32, 6);
  for (const std::size_t at : Sizes{0, 7, 8, chunk - 8, chunk - 1, chunk, 4095, 4999}) {
    SCOPED_TRACE(at);
    std::vector<float> decoded = approximation_of(tile, 0.1);
    for (const float nan : {unused, -unused}) {
      decoded[at] = nan;
      const ErrorSums with_nan = errors(tile, decoded, 1.0f);
      EXPECT_TRUE(std::isnan(with_nan.max_difference));
      EXPECT_TRUE(std::isnan(with_nan.square_difference));
      EXPECT_FALSE(std::isnan(with_nan.square_reference));
      EXPECT_TRUE(std::isnan(reference::error_sums(tile.values, widened(decoded)).max_difference));
    }
    decoded[at] = -std::numeric_limits<float>::infinity();
    const ErrorSums with_infinity = errors(tile, decoded, 1.0f);
    EXPECT_EQ(with_infinity.max_difference, std::numeric_limits<double>::infinity());
    EXPECT_EQ(with_infinity.square_difference, std::numeric_limits<double>::infinity());
  }
}

TEST(ErrorSums, NonFiniteInputsAreZeroWhereAskedFor) {
  std::vector<double> values(2100, 0.5);
  values[3] = std::nan("");
  values[2099] = -std::numeric_limits<double>::infinity();
  Tile tile = tile_of(1, 2100, 1, DType::f32, values);
  const std::vector<float> decoded(2100, 0.5f);
  EXPECT_TRUE(std::isnan(errors(tile, decoded, 1.0f).max_difference));
  tile.shape.nan_zero = true;
  tile.values[3] = 0;
  tile.values[2099] = 0;
  expect_errors(tile, decoded, 1.0f);
}

}  // namespace
}  // namespace weft::test
