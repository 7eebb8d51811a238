// Sums, range and the first non-finite value of raw tiles, at sizes about the vector (8 texels) and
// the chunk (1024 texels).
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

// A chunk's sum: 8-bit values divided by 255 (u); compensated sums of lanes (2 u), rounded (u), and
// added up likewise (2 u); terms in u^2 besides.
double sum_tolerance(const std::vector<double>& finite_magnitudes, std::size_t row) {
  return gamma(8, float_roundoff) * finite_magnitudes[row];
}

ops::TileScan expect_scan(const Tile& tile) {
  SCOPED_TRACE(testing::Message() << tile);
  Device& device = shared_device();
  GuardedBuffer raw = guarded_raw(tile);
  ops::TileScan actual = ops::scan_tile(device, tile.shape, raw.buffer());
  const ops::TileShape& shape = tile.shape;
  const reference::TileScan expected =
      reference::scan_tile(shape.images, shape.texels, shape.channels, tile.values);
  std::vector<double> size = tile.values;
  for (double& value : size) value = std::abs(value);
  const std::vector<double> magnitudes =
      reference::scan_tile(shape.images, shape.texels, shape.channels, size).sums;
  EXPECT_TRUE(all_near(actual.sums, expected.sums,
                       [&](std::size_t row) { return sum_tolerance(magnitudes, row); }));
  const double rounding = shape.dtype == DType::u8 ? float_roundoff * expected.largest : 0.0;
  EXPECT_NEAR(static_cast<double>(actual.largest), expected.largest, rounding);
  EXPECT_EQ(actual.first_bad, expected.first_bad);
  EXPECT_TRUE(raw.intact());
  // the same bits again
  const ops::TileScan again = ops::scan_tile(device, shape, raw.buffer());
  EXPECT_TRUE(same_bits(again.sums, actual.sums));
  return actual;
}

TEST(ScanTile, SmallOfEveryType) {
  for (const DType dtype : raw_types) {
    expect_scan(random_tile(2, 19, 3, dtype, 1));
    expect_scan(random_tile(1, 9, 2, dtype, 2));
  }
}

TEST(ScanTile, StraddlesVectorsAndChunks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 2, 3, 4, 7}) {
      for (const std::size_t texels : Sizes{1, 7, 8, 9, 23, 1023, 1024, 1025, 2049}) {
        for (const std::size_t images : Sizes{1, 3}) {
          expect_scan(random_tile(images, texels, channels, dtype, 3));
        }
      }
    }
  }
}

// Where a plain sum in float would stand still: 2^24 and many ones.
TEST(ScanTile, SumsAreCompensated) {
  std::vector<double> values(1024, 1.0);
  values[0] = 0x1p24;
  expect_scan(tile_of(1, 1024, 1, DType::f32, values));
}

TEST(ScanTile, WholeNumbersAreExact) {
  const std::vector<float> integers = random_integers(2 * 1500 * 3, 4, 60);
  const std::vector<double> values = widened(integers);
  for (const DType dtype : {DType::f16, DType::f32}) {
    const Tile tile = tile_of(2, 1500, 3, dtype, values);
    EXPECT_TRUE(all_equal(expect_scan(tile).sums, reference::scan_tile(2, 1500, 3, values).sums));
  }
}

TEST(ScanTile, Extremes) {
  for (const double value : {0.0, -0.0, 0x1p-149, -0x1p-140, 1e-30, 1e30, -1e30}) {
    expect_scan(tile_of(1, 1030, 3, DType::f32, std::vector<double>(3090, value)));
  }
  for (const double value : {0x1p-24, -0x1p-20, 65504.0, -65504.0}) {
    expect_scan(tile_of(1, 1030, 3, DType::f16, std::vector<double>(3090, value)));
  }
  // the largest magnitude may be negative, and anywhere
  for (const std::size_t at : Sizes{0, 7, 8, 3071, 3072, 3089}) {
    std::vector<double> values(3090, 0.5);
    values[at] = -3.0;
    EXPECT_EQ(expect_scan(tile_of(1, 1030, 3, DType::f32, values)).largest, 3.0f);
  }
}

// The first of all in storage order: in the body of vectors, at the edges of chunks, in the last
// texels, in the second image. Sums and range go on without it.
TEST(ScanTile, FindsTheFirstNonFiniteValue) {
  const std::size_t texels = 1029;
  const std::size_t channels = 3;
  const std::size_t image = texels * channels;
  for (const DType dtype : {DType::f16, DType::f32}) {
    for (const double bad : {std::nan(""), -std::nan(""), std::numeric_limits<double>::infinity(),
                             -std::numeric_limits<double>::infinity()}) {
      for (const std::size_t at : Sizes{0, 7, 8, 23, 24, 3069, 3071, 3072, 3073, image - 15,
                                        image - 1, image, image + 3072, 2 * image - 1}) {
        Tile tile = random_tile(2, texels, channels, dtype, 5);
        tile.values[at] = bad;
        EXPECT_EQ(expect_scan(tile_of(2, texels, channels, dtype, tile.values)).first_bad, at);
        // one more behind it changes nothing
        tile.values[2 * image - 1] = bad;
        EXPECT_EQ(expect_scan(tile_of(2, texels, channels, dtype, tile.values)).first_bad, at);
      }
    }
  }
  EXPECT_FALSE(expect_scan(random_tile(2, texels, channels, DType::f32, 5)).first_bad);
}

}  // namespace
}  // namespace weft::test
