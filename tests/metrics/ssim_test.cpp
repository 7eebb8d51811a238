// Structural similarity against scikit-image and values worked out by hand.
#include "weft/metrics/ssim.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"

namespace weft::test {
namespace {

// The images of the golden values: [24][31][3], integers / 255.
constexpr int height = 24, width = 31, channels = 3;
struct Pair {
  std::vector<double> a, b;
};
Pair golden_images() {
  Pair images;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        const int a = std::abs((3 * y + 5 * x + 11 * c) % 64 - 32) * 4 + (7 * x * y + 13 * c) % 32;
        const int b = a * 7 / 8 + (x * x + 3 * y + 29 * c) % 23;
        images.a.push_back(a / 255.0);
        images.b.push_back(b / 255.0);
      }
    }
  }
  return images;
}

// From scikit-image 0.19.3:
//
//   y, x, c = numpy.mgrid[0:24, 0:31, 0:3]
//   a = abs((3*y + 5*x + 11*c) % 64 - 32) * 4 + (7*x*y + 13*c) % 32
//   b = a * 7 // 8 + (x*x + 3*y + 29*c) % 23
//   _, map = skimage.metrics.structural_similarity(a / 255, b / 255, data_range=peak,
//       gaussian_weights=True, sigma=1.5, use_sample_covariance=False, channel_axis=2, full=True)
//   print(map[5:-5, 5:-5].mean())
//
// Its own mean takes windows that reach beyond the image; the crop is what lies inside.
TEST(Ssim, AgreesWithScikitImage) {
  const Pair images = golden_images();
  EXPECT_NEAR(ssim(height, width, channels, images.a, images.b, 1.0), 0.9590558312795818, 1e-12);
  EXPECT_NEAR(ssim(height, width, channels, images.a, images.b, 4.0), 0.9743996589814367, 1e-12);
  std::vector<double> inverse = images.a;
  for (double& value : inverse) value = 1 - value;
  EXPECT_NEAR(ssim(height, width, channels, images.a, inverse, 1.0), -0.6555114785216131, 1e-12);
}

TEST(Ssim, OfAnImageWithItselfIsOne) {
  const std::vector<double> image = random_values(15 * 12 * 3, 1);
  EXPECT_NEAR(ssim(15, 12, 3, image, image, 1.0), 1.0, 1e-14);
  const std::vector<double> black(11 * 11, 0.0);
  EXPECT_EQ(ssim(11, 11, 1, black, black, 1.0), 1.0);
}

// Constant against constant: both variances are 0, so that the means alone remain.
TEST(Ssim, OfConstantsComparesTheirMeans) {
  const std::vector<double> x(13 * 17, 0.25), y(13 * 17, 0.75);
  const double c1 = 1e-4;
  const double expected = (2 * 0.25 * 0.75 + c1) / (0.25 * 0.25 + 0.75 * 0.75 + c1);
  EXPECT_NEAR(ssim(13, 17, 1, x, y, 1.0), expected, 1e-12);
}

// One window over 11 x 11 texels: y = x + 0.5 at the centre alone. With w the centre's weight,
// mu_y = w / 2, var_y = w / 4 - w^2 / 4, and the covariance with a black x is 0.
TEST(Ssim, OfOneTexelFollowsTheFormula) {
  const std::vector<double> x(121, 0.0);
  std::vector<double> y(121, 0.0);
  y[60] = 0.5;
  const std::array<double, ssim_window> weights = ssim_weights();
  const double w = weights[5] * weights[5];
  const double c1 = 1e-4, c2 = 9e-4;
  const double expected = c1 / (w * w / 4 + c1) * c2 / (w / 4 - w * w / 4 + c2);
  EXPECT_NEAR(ssim(11, 11, 1, x, y, 1.0), expected, 1e-13);
}

TEST(Ssim, WeightsAreAGaussianThatSumsToOne) {
  const std::array<double, ssim_window> weights = ssim_weights();
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 1.0, 1e-15);
  for (std::size_t t = 0; t < ssim_window; ++t) EXPECT_EQ(weights[t], weights[10 - t]);
  EXPECT_NEAR(std::log(weights[5] / weights[2]), 9 / 4.5, 1e-14);
}

// The same for values and peak times any factor, and symmetric.
TEST(Ssim, IsSymmetricAndKnowsNoUnit) {
  const Pair images = golden_images();
  const double similarity = ssim(height, width, channels, images.a, images.b, 1.0);
  EXPECT_NEAR(ssim(height, width, channels, images.b, images.a, 1.0), similarity, 1e-13);
  Pair scaled = images;
  for (double& value : scaled.a) value *= 1e30;
  for (double& value : scaled.b) value *= 1e30;
  EXPECT_NEAR(ssim(height, width, channels, scaled.a, scaled.b, 1e30), similarity, 1e-12);
}

TEST(Ssim, NanShows) {
  Pair images = golden_images();
  images.b[1000] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(ssim(height, width, channels, images.a, images.b, 1.0)));
  SsimSums sums;
  sums.add(0.5);
  sums.add(std::numeric_limits<double>::quiet_NaN());
  sums.add(0.25);
  EXPECT_TRUE(std::isnan(sums.lowest));
  EXPECT_TRUE(std::isnan(sums.mean()));
}

TEST(Ssim, SumsKeepTheLowest) {
  SsimSums sums;
  sums.add(0.5);
  SsimSums others;
  others.add(0.25);
  others.add(1.0);
  sums.merge(others);
  EXPECT_EQ(sums.images, 3u);
  EXPECT_DOUBLE_EQ(sums.mean(), 1.75 / 3);
  EXPECT_EQ(sums.lowest, 0.25);
}

TEST(Ssim, RefusesWhatHasNoWindowOrPeak) {
  const std::vector<double> image(10 * 40, 0.5);
  expect_error(ErrorKind::input, {"11 x 11", "10 x 40"},
               [&] { ssim(10, 40, 1, image, image, 1.0); });
  expect_error(ErrorKind::input, {"11 x 11", "40 x 10"},
               [&] { ssim(40, 10, 1, image, image, 1.0); });
  const std::vector<double> large(11 * 11, 0.5);
  for (const double peak : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    expect_error(ErrorKind::input, {"peak"}, [&] { ssim(11, 11, 1, large, large, peak); });
  }
}

}  // namespace
}  // namespace weft::test
