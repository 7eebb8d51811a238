// Raw tiles to centred panels, at sizes about the vector (8 texels), the panel (24) and the block
// of 16 panels that one work-item converts.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/tiles.hpp"
#include "support/matchers.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/tile.hpp"

namespace weft::test {
namespace {

// One lane adds at most 16 panels in vectors of 8 texels, and a last few texels, per channel; then
// 8 lanes.
double squares_terms(std::size_t width, std::size_t channels) {
  return static_cast<double>((16 * width / 8 + 8) * channels + 8);
}

struct Converted {
  std::vector<float> panels;
  double squares = 0;
};

// Checks rows, padding and squares against the reference.
Converted expect_convert(const Tile& tile, std::span<const float> row_means, float scale) {
  SCOPED_TRACE(testing::Message() << tile << ", scale " << scale);
  Device& device = shared_device();
  const ops::TileShape& shape = tile.shape;
  const std::size_t width = ops::panel_width(device);
  // the means of the tile's rows lie behind those of others
  const std::size_t first_row = 5;
  std::vector<float> means(first_row, unused);
  means.insert(means.end(), row_means.begin(), row_means.end());
  GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer mean(device, std::span<const float>(means), "mean");
  GuardedBuffer panels(device, ops::panel_elements(device, shape) * sizeof(float), "panels");
  ops::convert_tile(device, shape, raw.buffer(), mean.buffer(), first_row, scale, panels.buffer());
  Converted result;
  result.panels = panels.values<float>();
  EXPECT_TRUE(panels.intact());

  std::vector<double> values = tile.values;
  for (double& value : values) {
    if (shape.nan_zero && !std::isfinite(value)) value = 0;
  }
  const std::vector<double> rows = reference::convert_tile(
      shape.images, shape.texels, shape.channels, values, widened(row_means), double{scale});
  // panels(row, p) is row-major with panels across the texels
  const std::vector<float> actual = from_panels(result.panels, shape.rows(), shape.texels, width);
  EXPECT_TRUE(all_near(actual, rows, [&](std::size_t i) {
    // the difference is rounded, and so is an 8-bit value's x / 255; a result may be subnormal
    const double mean_size = std::abs(double{row_means[i / shape.texels]});
    const double value = std::abs(rows[i]) / double{scale} + mean_size;
    const double of_value = shape.dtype == DType::u8 ? value : 0.0;
    return double{scale} * float_roundoff * (std::abs(rows[i]) / double{scale} + 2 * of_value) +
           0x1p-149;
  }));
  const std::vector<float> padded = panels_of(actual, shape.rows(), shape.texels, width, 0.0f);
  EXPECT_TRUE(same_bits(result.panels, padded)) << "padding is not zero";

  // the same with squares: the same panels, and the sum added to what was there
  double squares = 0.5;
  GuardedBuffer again(device, panels.buffer().size(), "panels");
  ops::convert_tile(device, shape, raw.buffer(), mean.buffer(), first_row, scale, again.buffer(),
                    &squares);
  EXPECT_TRUE(same_bits(again.values<float>(), result.panels));
  EXPECT_TRUE(again.intact());
  EXPECT_TRUE(mean.intact());
  result.squares = squares - 0.5;
  double expected = 0;
  for (const float value : actual) expected += double{value} * double{value};
  const double terms = squares_terms(width, shape.channels);
  const double tolerance =
      gamma(terms, float_roundoff) * expected + double_roundoff * (2 * expected + 1);
  EXPECT_NEAR(squares, 0.5 + expected, tolerance);
  return result;
}

TEST(ConvertTile, SmallOfEveryType) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 2, 3}) {
      Tile tile = random_tile(2, 29, channels, dtype, 1);
      tile.shape.nan_zero = channels == 2;
      expect_convert(tile, random_floats(tile.shape.rows(), 2, -1.0, 1.0), 0.25f);
    }
  }
}

TEST(ConvertTile, StraddlesVectorsPanelsAndBlocks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 2, 3, 4, 7}) {
      for (const std::size_t texels :
           Sizes{1, 7, 8, 9, 16, 17, 23, 24, 25, 31, 383, 384, 385, 800}) {
        for (const std::size_t images : Sizes{1, 3}) {
          const Tile tile = random_tile(images, texels, channels, dtype, 3);
          expect_convert(tile, random_floats(tile.shape.rows(), 4, -1.0, 1.0), 1.0f);
        }
      }
    }
  }
}

// The other forms: double, and transposed in both arithmetics.
template <typename Real>
void expect_forms(const Tile& tile, float scale) {
  SCOPED_TRACE(testing::Message() << tile << ", " << 8 * sizeof(Real) << " bits");
  Device& device = shared_device();
  constexpr Arithmetic arithmetic = sizeof(Real) == 4 ? Arithmetic::f32 : Arithmetic::f64;
  const ops::TileShape& shape = tile.shape;
  const std::size_t width = ops::panel_width(device, arithmetic);
  const std::vector<float> row_means = random_floats(shape.rows(), 8, -1.0, 1.0);
  std::vector<float> means(3, unused);
  means.insert(means.end(), row_means.begin(), row_means.end());
  GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer mean(device, std::span<const float>(means), "mean");
  std::vector<double> values = tile.values;
  for (double& value : values) {
    if (shape.nan_zero && !std::isfinite(value)) value = 0;
  }
  const std::vector<double> rows = reference::convert_tile(
      shape.images, shape.texels, shape.channels, values, widened(row_means), double{scale});
  const double u = sizeof(Real) == 4 ? float_roundoff : double_roundoff;
  // as in expect_convert()
  const auto tolerance = [&](std::size_t i) {
    const double value = std::abs(rows[i]) + double{scale} * std::abs(row_means[i / shape.texels]);
    return u * (std::abs(rows[i]) + (shape.dtype == DType::u8 ? 4 * value : 0.0)) + 0x1p-149;
  };

  GuardedBuffer panels(device, ops::panel_elements(device, shape, arithmetic) * sizeof(Real),
                       "panels");
  double squares = 0;
  ops::convert_tile(device, shape, raw.buffer(), mean.buffer(), 3, scale, panels.buffer(), &squares,
                    arithmetic);
  const std::vector<Real> straight = panels.values<Real>();
  const std::vector<Real> actual = from_panels(straight, shape.rows(), shape.texels, width);
  EXPECT_TRUE(all_near(actual, rows, tolerance));
  EXPECT_TRUE(same_bits(straight, panels_of(actual, shape.rows(), shape.texels, width, Real{0})));
  EXPECT_TRUE(panels.intact());
  double expected = 0;
  for (const Real value : actual) expected += double{value} * double{value};
  const double terms = squares_terms(width, shape.channels);
  EXPECT_NEAR(
      squares, expected,
      (gamma(terms, u) + gamma(static_cast<double>(actual.size()), double_roundoff)) * expected);

  // the same values transposed, to the bit
  GuardedBuffer turned(
      device, ops::transposed_panel_elements(device, shape, arithmetic) * sizeof(Real), "panels");
  ops::convert_tile_transposed(device, shape, raw.buffer(), mean.buffer(), 3, scale,
                               turned.buffer(), arithmetic);
  EXPECT_TRUE(
      same_bits(turned.values<Real>(), panels_of(transpose(actual, shape.rows(), shape.texels),
                                                 shape.texels, shape.rows(), width, Real{0})));
  EXPECT_TRUE(turned.intact());
  EXPECT_TRUE(mean.intact());
}

TEST(ConvertTile, SmallInOtherForms) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 2, 3}) {
      Tile tile = random_tile(5, 29, channels, dtype, 9);
      tile.shape.nan_zero = channels == 2;
      expect_forms<float>(tile, 0.25f);
      expect_forms<double>(tile, 0.25f);
    }
  }
}

TEST(ConvertTile, OtherFormsStraddleVectorsPanelsAndBlocks) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 3, 4, 7, 31}) {
      for (const std::size_t texels : Sizes{1, 7, 8, 9, 12, 13, 25, 191, 192, 193, 511, 512, 513}) {
        for (const std::size_t images : Sizes{1, 3, 8, 9, 17}) {
          const Tile tile = random_tile(images, texels, channels, dtype, 10);
          expect_forms<float>(tile, 1.0f);
          expect_forms<double>(tile, 1.0f);
        }
      }
    }
  }
}

TEST(ConvertTile, WhatIsItsMeanIsZero) {
  // 0.3 as float and as half is not 0.3: the mean is that of the stored value
  for (const DType dtype : {DType::f16, DType::f32}) {
    const Tile tile = tile_of(2, 30, 3, dtype, std::vector<double>(180, 0.3));
    const std::vector<float> mean(6, static_cast<float>(tile.values[0]));
    EXPECT_EQ(expect_convert(tile, mean, 2.0f).squares, 0.0);
  }
}

TEST(ConvertTile, ScalesKeepSquaresInRange) {
  const std::vector<float> no_mean(3, 0.0f);
  for (const double size : {1e30, 1e-30, 3e38, 0x1p-149}) {
    std::vector<double> values = random_values(400 * 3, 5, -size, size);
    values[17] = size;
    int exponent = 0;
    std::frexp(size, &exponent);
    const float scale = std::ldexp(1.0f, std::min(-exponent, 127));
    const Converted converted =
        expect_convert(tile_of(1, 400, 3, DType::f32, values), no_mean, scale);
    EXPECT_GT(converted.squares, 0.0);
    EXPECT_TRUE(std::isfinite(converted.squares));
  }
}

TEST(ConvertTile, NonFiniteValuesAreZeroWhereAskedFor) {
  const double bad[] = {std::nan(""), std::numeric_limits<double>::infinity(),
                        -std::numeric_limits<double>::infinity()};
  for (const DType dtype : {DType::f16, DType::f32}) {
    for (const std::size_t channels : Sizes{1, 2, 3}) {
      const std::size_t texels = 53;
      std::vector<double> values = random_values(texels * channels, 6, -1.0, 1.0);
      // in whole vectors and in the last few texels
      for (const std::size_t at : Sizes{0, 11, texels * channels - 1}) {
        values[at] = bad[at % 3];
      }
      Tile tile = tile_of(1, texels, channels, dtype, values);
      tile.shape.nan_zero = true;
      expect_convert(tile, random_floats(channels, 7, -1.0, 1.0), 1.0f);
    }
  }
}

}  // namespace
}  // namespace weft::test
