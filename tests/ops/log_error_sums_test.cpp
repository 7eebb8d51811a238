// Errors of decoded tiles on a logarithmic scale, at sizes about the vector (8 values) and the
// chunk (2048 values), and their figures.
#include "weft/ops/log_error_sums.hpp"

#include <gtest/gtest.h>

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

void expect_errors(const Tile& tile, std::span<const float> decoded, double scale) {
  SCOPED_TRACE(testing::Message() << tile << ", scale " << scale);
  GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer approximation(shared_device(), decoded, "decoded");
  const LogErrorSums actual =
      ops::log_error_sums(shared_device(), tile.shape, raw.buffer(), approximation.buffer(), scale);
  EXPECT_TRUE(raw.intact());
  EXPECT_TRUE(approximation.intact());
  const std::vector<double> values = widened(decoded);
  const LogErrorSums expected = reference::log_error_sums(tile.values, values, scale);
  EXPECT_EQ(actual.count, tile.values.size());

  // A logarithm is off by 2 units in the last place of log1p, 4 u, and by its argument's 3 u (an
  // 8-bit value, s, a quotient), which no logarithm makes larger; a chunk's squares are added in
  // chunk / 8 steps and 3 sums of lanes.
  const double of_sum = gamma(chunk / 8.0 + 4, float_roundoff);
  double difference_tolerance = 0, reference_tolerance = 0;
  for (std::size_t i = 0; i < tile.values.size(); ++i) {
    const double l = std::log1p(std::abs(tile.values[i]) / scale);
    const double other = std::log1p(std::abs(values[i]) / scale);
    const double d = std::abs(std::copysign(l, tile.values[i]) - std::copysign(other, values[i]));
    const double e = 8 * float_roundoff * (l + other);
    difference_tolerance += 2 * d * e + e * e + of_sum * (d + e) * (d + e);
    reference_tolerance += 2 * l * e + e * e + of_sum * (l + e) * (l + e);
  }
  EXPECT_NEAR(actual.square_difference, expected.square_difference, difference_tolerance);
  EXPECT_NEAR(actual.square_reference, expected.square_reference, reference_tolerance);
}

std::vector<float> approximation_of(const Tile& tile) {
  std::vector<float> decoded(tile.values.begin(), tile.values.end());
  const std::vector<float> errors = random_floats(decoded.size(), 9, -0.2, 0.2);
  for (std::size_t i = 0; i < decoded.size(); ++i) decoded[i] += errors[i];
  return decoded;
}

TEST(LogErrorSums, SmallOfEveryType) {
  for (const DType dtype : raw_types) {
    const Tile tile = random_tile(1, 13, 3, dtype, 1);
    expect_errors(tile, approximation_of(tile), 0.3);
  }
}

TEST(LogErrorSums, StraddlesVectorsAndChunks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t texels : Sizes{1, 7, 8, 9, chunk - 1, chunk, chunk + 1, 3 * chunk}) {
      const Tile tile = random_tile(1, texels, 1, dtype, texels);
      expect_errors(tile, approximation_of(tile), 1.0);
    }
  }
}

TEST(LogErrorSums, ExtremesOfMagnitude) {
  for (const double magnitude : {1e30, 65504.0, 1e-30}) {
    std::vector<double> values = random_values(40, 3, -1, 1);
    std::vector<float> decoded;
    for (double& value : values) {
      value *= magnitude;
      decoded.push_back(static_cast<float>(1.25 * value));
    }
    values[3] = 0;
    expect_errors(tile_of(1, 40, 1, DType::f32, values), decoded, magnitude / 10);
  }
}

TEST(LogErrorSums, FiguresAreTheFormulas) {
  // l(1) = ln 2, l(3) = ln 4: T = (1, -3, 0), T' = (1, -1, 0) at s = 1
  const std::vector<double> values{1, -3, 0}, decoded{1, -1, 0};
  const LogErrorReport figures = report(reference::log_error_sums(values, decoded, 1), 1);
  const double ln2 = std::log(2.0);
  EXPECT_NEAR(figures.rmse, ln2 / std::sqrt(3.0), 1e-15);
  EXPECT_NEAR(figures.snr, 10 * std::log10(5.0), 1e-13);
  EXPECT_EQ(figures.scale, 1);
  const LogErrorReport exact = report(reference::log_error_sums(values, values, 1), 1);
  EXPECT_EQ(exact.rmse, 0);
  EXPECT_EQ(exact.snr, std::numeric_limits<double>::infinity());
  const std::vector<double> zero{0};
  EXPECT_TRUE(
      std::isnan(report(reference::log_error_sums(zero, std::span(decoded).first(1), 1), 1).snr));
}

}  // namespace
}  // namespace weft::test
