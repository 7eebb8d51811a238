// Structural similarity on the device, at sizes about the window (11), the vector (8 values) and
// the work-item's rows (32 rows of windows), against the formula in double.
#include "weft/ops/ssim.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/tiles.hpp"
#include "support/expect_error.hpp"
#include "support/matchers.hpp"
#include "weft/metrics/ssim.hpp"

namespace weft::test {
namespace {

constexpr std::size_t block_rows = 32;

struct Images {
  Tile tile;
  std::size_t height = 0, width = 0;

  std::size_t row() const { return width * tile.shape.channels; }
  std::size_t size() const { return height * row(); }
};

Images images_of(std::size_t count, std::size_t height, std::size_t width, std::size_t channels,
                 DType dtype, std::span<const double> values) {
  Images images{tile_of(count, height * width, channels, dtype, values), height, width};
  // as the device holds them
  for (double& value : images.tile.values) value = static_cast<double>(static_cast<float>(value));
  return images;
}

Images random_images(std::size_t count, std::size_t height, std::size_t width, std::size_t channels,
                     DType dtype, std::uint64_t seed) {
  return images_of(count, height, width, channels, dtype,
                   random_values(count * height * width * channels, seed));
}

std::vector<float> approximation_of(const Images& images, double size) {
  std::vector<float> decoded(images.tile.values.begin(), images.tile.values.end());
  const std::vector<float> errors = random_floats(decoded.size(), 9, -size, size);
  for (std::size_t i = 0; i < decoded.size(); ++i) decoded[i] += errors[i];
  return decoded;
}

std::vector<double> similarities(const Images& images, std::span<const float> decoded,
                                 double peak) {
  GuardedBuffer raw = guarded_raw(images.tile);
  GuardedBuffer approximation(shared_device(), decoded, "decoded");
  const auto once = [&] {
    return ops::ssim(shared_device(), images.tile.shape, images.width, raw.buffer(),
                     approximation.buffer(), peak);
  };
  const std::vector<double> result = once();
  EXPECT_TRUE(raw.intact());
  EXPECT_TRUE(approximation.intact());
  EXPECT_TRUE(same_bits(once(), result));
  return result;
}

// What rounding may do to the mean of an image, to first order. The terms of a window: v = x - s, s
// the value of x that variances are taken about; y' = v - d; d = x - y. A weighted mean of values
// is off by g times the mean of their magnitudes: 22 products and sums, the weights' and the terms'
// own roundings. With E the weighted mean, a variance is then off by 4 g E[v^2].
double rounding_bound(const Images& images, std::size_t image, std::span<const double> decoded,
                      double peak) {
  const double g = gamma(30, float_roundoff);
  const std::size_t channels = images.tile.shape.channels;
  const std::size_t columns = images.row() - 10 * channels, rows = images.height - 10;
  const double* x = images.tile.values.data() + image * images.size();
  const double* y = decoded.data() + image * images.size();
  const std::array<double, ssim_window> w = ssim_weights();
  const double c1 = 1e-4 * peak * peak, c2 = 9e-4 * peak * peak;
  double sum = 0;
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t j = 0; j < columns; ++j) {
      const double s = x[(r / block_rows * block_rows + 5) * images.row() + j + 5 * channels];
      double mx = 0, my = 0, md = 0, ax = 0, ad = 0, vv = 0, yy = 0, dd = 0;
      for (std::size_t t = 0; t < 121; ++t) {
        const double weight = w[t / 11] * w[t % 11];
        const std::size_t at = (r + t / 11) * images.row() + j + t % 11 * channels;
        const double d = x[at] - y[at], v = x[at] - s;
        mx += weight * x[at];
        my += weight * y[at];
        md += weight * d;
        ax += weight * std::abs(v);
        ad += weight * std::abs(d);
        vv += weight * v * v;
        yy += weight * (v - d) * (v - d);
        dd += weight * d * d;
      }
      const double e_md = g * ad;
      const double e_mx = g * ax + float_roundoff * std::abs(mx);
      const double e_my = e_mx + e_md + float_roundoff * std::abs(my);
      const double b1 = mx * mx + my * my + c1;
      const double vx = vv - (mx - s) * (mx - s), vy = yy - (my - s) * (my - s), vd = dd - md * md;
      const double b2 = vx + vy + c2;
      const double p = md * md / b1, q = vd / b2;
      const double of_p =
          (2 * std::abs(md) * e_md + 2 * p * (std::abs(mx) * e_mx + std::abs(my) * e_my)) / b1 +
          6 * float_roundoff * p;
      const double of_q = (4 * g * dd + 4 * g * q * (vv + yy)) / b2 + 6 * float_roundoff * q;
      // the sum of a lane's rows and of the lanes
      sum += of_p + of_q + gamma(block_rows + 10, float_roundoff) * (p + q + p * q);
    }
  }
  return 1.01 * sum / static_cast<double>(rows * columns);
}

void expect_similarities(const Images& images, std::span<const float> decoded, double peak) {
  SCOPED_TRACE(testing::Message() << images.tile << ", " << images.height << " x " << images.width
                                  << ", peak " << peak);
  const std::vector<double> actual = similarities(images, decoded, peak);
  const std::vector<double> wide = widened(decoded);
  ASSERT_EQ(actual.size(), images.tile.shape.images);
  for (std::size_t image = 0; image < actual.size(); ++image) {
    const double expected =
        ssim(images.height, images.width, images.tile.shape.channels,
             std::span(images.tile.values).subspan(image * images.size(), images.size()),
             std::span<const double>(wide).subspan(image * images.size(), images.size()), peak);
    const double bound = rounding_bound(images, image, wide, peak);
    EXPECT_NEAR(actual[image], expected, bound) << "image " << image;
    EXPECT_LT(bound, 1e-3);
  }
}

TEST(Ssim, SmallOfEveryType) {
  for (const DType dtype : raw_types) {
    const Images images = random_images(1, 12, 14, 3, dtype, 1);
    expect_similarities(images, approximation_of(images, 0.1), 1.0);
  }
}

TEST(Ssim, StraddlesWindowsVectorsAndRows) {
  for (const std::size_t width : Sizes{11, 12, 17, 18, 19, 26, 27}) {
    const Images images = random_images(2, 11, width, 1, DType::f32, 2);
    expect_similarities(images, approximation_of(images, 0.2), 1.0);
  }
  for (const std::size_t height : Sizes{11, 12, 41, 42, 43, 74, 75}) {
    const Images images = random_images(1, height, 13, 3, DType::f16, 3);
    expect_similarities(images, approximation_of(images, 0.01), 2.0);
  }
  for (const std::size_t channels : Sizes{1, 2, 3, 4, 7, 31}) {
    const Images images = random_images(3, 13, 15, channels, DType::u8, 4);
    expect_similarities(images, approximation_of(images, 0.3), 1.0);
  }
}

// Equal images are 1 to the bit.
TEST(Ssim, OfTheSameImageIsOne) {
  for (const DType dtype : raw_types) {
    const Images images = random_images(2, 20, 21, 3, dtype, 5);
    for (const double similarity : similarities(images, approximation_of(images, 0.0), 1.0)) {
      EXPECT_EQ(similarity, 1.0);
    }
  }
}

// Bright and nearly constant: the variance is 1e-6 of the squared mean.
TEST(Ssim, SmallVarianceAboutALargeMean) {
  std::vector<double> values = random_values(24 * 24, 6, -1e-3, 1e-3);
  for (double& value : values) value += 0.9;
  const Images images = images_of(1, 24, 24, 1, DType::f32, values);
  expect_similarities(images, approximation_of(images, 1e-3), 1.0);
  EXPECT_LT(rounding_bound(images, 0, widened(approximation_of(images, 1e-3)), 1.0), 1e-8);
}

TEST(Ssim, ScalesWithThePeak) {
  const Images images = random_images(1, 16, 16, 3, DType::f32, 7);
  const std::vector<float> decoded = approximation_of(images, 0.1);
  const double expected = similarities(images, decoded, 1.0)[0];
  for (const int exponent : {100, -100}) {
    Images scaled = images;
    std::vector<double> values = images.tile.values;
    for (double& value : values) value = std::ldexp(value, exponent);
    scaled.tile = tile_of(1, 16 * 16, 3, DType::f32, values);
    std::vector<float> scaled_decoded = decoded;
    for (float& value : scaled_decoded) value = std::ldexp(value, exponent);
    EXPECT_EQ(similarities(scaled, scaled_decoded, std::ldexp(1.0, exponent))[0], expected);
  }
}

// Wherever it is, a NaN shows, in its own image alone.
TEST(Ssim, NanShows) {
  const Images images = random_images(3, 45, 15, 1, DType::f32, 8);
  for (const std::size_t at : Sizes{0, 7, 14, 44 * 15, 45 * 15 - 1}) {
    std::vector<float> decoded = approximation_of(images, 0.1);
    decoded[images.size() + at] = unused;
    const std::vector<double> result = similarities(images, decoded, 1.0);
    EXPECT_FALSE(std::isnan(result[0]));
    EXPECT_TRUE(std::isnan(result[1]));
    EXPECT_FALSE(std::isnan(result[2]));
  }
}

TEST(Ssim, NonFiniteInputsAreZeroWhereAskedFor) {
  std::vector<double> values = random_values(12 * 12, 10);
  values[70] = std::numeric_limits<double>::infinity();
  Images images = images_of(1, 12, 12, 1, DType::f32, values);
  images.tile.shape.nan_zero = true;
  images.tile.values[70] = 0;
  expect_similarities(images, approximation_of(images, 0.1), 1.0);
}

TEST(Ssim, RefusesWhatHasNoWindow) {
  const Images images = random_images(1, 10, 30, 1, DType::f32, 11);
  const std::vector<float> decoded = approximation_of(images, 0.1);
  expect_error(ErrorKind::input, {"11 x 11", "10 x 30"},
               [&] { similarities(images, decoded, 1.0); });
}

}  // namespace
}  // namespace weft::test
