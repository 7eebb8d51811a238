// Weighted sums of squares of decoded tiles, at sizes about the vector (8 values) and the chunk
// (2048 values), image by image.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/tiles.hpp"
#include "support/matchers.hpp"

namespace weft::test {
namespace {

constexpr std::size_t chunk = 2048;

void expect_squares(const Tile& tile, double size, float scale) {
  SCOPED_TRACE(testing::Message() << tile << ", scale " << scale);
  std::vector<float> decoded(tile.values.begin(), tile.values.end());
  const std::vector<float> errors = random_floats(decoded.size(), 9, -size, size);
  for (std::size_t i = 0; i < decoded.size(); ++i) decoded[i] += errors[i];
  const std::size_t image = tile.shape.texels * tile.shape.channels;
  const std::vector<float> weights = random_floats(image, 4, 0.1, 3);
  GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer approximation(shared_device(), std::span<const float>(decoded), "decoded");
  GuardedBuffer of_texels(shared_device(), std::span<const float>(weights), "weights");
  const std::vector<ops::WeightedSquares> actual = ops::weighted_squares(
      shared_device(), tile.shape, raw.buffer(), approximation.buffer(), of_texels.buffer(), scale);
  EXPECT_TRUE(raw.intact());
  EXPECT_TRUE(approximation.intact());
  EXPECT_TRUE(of_texels.intact());
  ASSERT_EQ(actual.size(), tile.shape.images);

  // As for the plain sums: an error e of each value, and of a chunk's sum; the weight rounds once
  // more.
  const double of_value = tile.shape.dtype == DType::u8 ? float_roundoff : 0.0;
  const double of_sum = gamma(chunk / 8.0 + 11, float_roundoff);
  for (std::size_t n = 0; n < tile.shape.images; ++n) {
    double difference = 0;
    double reference = 0;
    double difference_tolerance = 0;
    double reference_tolerance = 0;
    for (std::size_t i = 0; i < image; ++i) {
      const double w = weights[i];
      const double value = std::abs(tile.values[n * image + i]);
      const double d = std::abs(tile.values[n * image + i] - double{decoded[n * image + i]});
      const double e = of_value * value + float_roundoff * (d + of_value * value);
      difference += w * d * d;
      reference += w * value * value;
      difference_tolerance += w * (2 * d * e + e * e + of_sum * (d + e) * (d + e));
      reference_tolerance += w * (2 * of_value + of_sum * (1 + 3 * of_value)) * value * value;
    }
    EXPECT_NEAR(actual[n].difference, difference, difference_tolerance) << "image " << n;
    EXPECT_NEAR(actual[n].reference, reference, reference_tolerance) << "image " << n;
  }
}

TEST(WeightedSquares, SmallOfEveryType) {
  for (const DType dtype : raw_types) expect_squares(random_tile(2, 13, 3, dtype, 1), 0.1, 1.0f);
}

TEST(WeightedSquares, StraddlesVectorsAndChunks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t texels :
         Sizes{1, 7, 8, 9, chunk - 1, chunk, chunk + 1, 2 * chunk, 5000}) {
      expect_squares(random_tile(2, texels, 1, dtype, 2), 0.1, 0.5f);
    }
    expect_squares(random_tile(3, 700, 3, dtype, 3), 1.0, 4.0f);
  }
}

// A tile's images are summed alike, however many there are in it.
TEST(WeightedSquares, ImagesDoNotDependOnEachOther) {
  const Tile tile = random_tile(3, 701, 3, DType::f32, 5);
  const std::size_t image = 701 * 3;
  const std::vector<float> decoded(tile.values.size(), 0.25f);
  const std::vector<float> weights = random_floats(image, 4, 0.1, 3);
  const auto squares = [&](std::size_t first, std::size_t count) {
    Tile part = tile;
    part.shape.images = count;
    const auto values = std::span<const double>(tile.values).subspan(first * image, count * image);
    part.raw = encode_values(values, DType::f32);
    GuardedBuffer raw = guarded_raw(part);
    GuardedBuffer approximation(shared_device(),
                                std::span<const float>(decoded).first(count * image), "decoded");
    GuardedBuffer of_texels(shared_device(), std::span<const float>(weights), "weights");
    return ops::weighted_squares(shared_device(), part.shape, raw.buffer(), approximation.buffer(),
                                 of_texels.buffer(), 1.0f);
  };
  const auto all = squares(0, 3);
  const auto one = squares(1, 1);
  EXPECT_EQ(all[1].difference, one[0].difference);
  EXPECT_EQ(all[1].reference, one[0].reference);
}

}  // namespace
}  // namespace weft::test
