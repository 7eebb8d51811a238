#include "weft/btf/mask_distance.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "support/generators.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

// From every texel to every other one and its repetitions on all sides.
std::vector<float> by_brute_force(const std::vector<std::uint8_t>& mask, std::size_t height,
                                  std::size_t width) {
  std::vector<float> result;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < mask.size(); ++j) {
      if (mask[i] == mask[j]) continue;
      for (int tile_y = -1; tile_y <= 1; ++tile_y) {
        for (int tile_x = -1; tile_x <= 1; ++tile_x) {
          const double dx = static_cast<double>(j % width) - static_cast<double>(i % width) +
                            tile_x * static_cast<double>(width);
          const double dy = static_cast<double>(j / width) - static_cast<double>(i / width) +
                            tile_y * static_cast<double>(height);
          nearest = std::min(nearest, std::sqrt(dx * dx + dy * dy));
        }
      }
    }
    result.push_back(static_cast<float>(mask[i] != 0 ? nearest - 0.5 : 0.5 - nearest));
  }
  return result;
}

std::vector<std::uint8_t> random_mask(std::size_t texels, double share, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::uint8_t> mask(texels);
  for (std::uint8_t& value : mask) value = random.uniform() < share ? 1 : 0;
  return mask;
}

TEST(MaskDistance, IsExactAcrossBorders) {
  struct Size {
    std::size_t height, width;
  };
  for (const Size size : {Size{1, 1}, {1, 7}, {8, 1}, {2, 2}, {5, 9}, {16, 11}, {17, 24}}) {
    for (const double share : {0.0, 0.02, 0.5, 0.97, 1.0}) {
      const auto mask = random_mask(size.height * size.width, share, 3 + size.width);
      EXPECT_EQ(signed_distances(mask, size.height, size.width),
                by_brute_force(mask, size.height, size.width))
          << size.height << " x " << size.width << ", " << share;
    }
  }
}

TEST(MaskDistance, OneTexelSeenFromAll) {
  std::vector<std::uint8_t> mask(8 * 8, 0);
  mask[0] = 1;
  const std::vector<float> distance = signed_distances(mask, 8, 8);
  EXPECT_EQ(distance[0], 0.5f);
  EXPECT_EQ(distance[1], -0.5f);
  EXPECT_EQ(distance[7], -0.5f);  // across the border
  EXPECT_EQ(distance[3 * 8 + 4], -4.5f);
  EXPECT_EQ(distance[4 * 8 + 4], static_cast<float>(0.5 - std::sqrt(32.0)));
}

TEST(MaskDistance, OfOneKindIsInfinite) {
  for (const float distance : signed_distances(std::vector<std::uint8_t>(6, 1), 2, 3)) {
    EXPECT_EQ(distance, infinity);
  }
  for (const float distance : signed_distances(std::vector<std::uint8_t>(6, 0), 2, 3)) {
    EXPECT_EQ(distance, -infinity);
  }
  EXPECT_THROW(signed_distances(std::vector<std::uint8_t>(6, 0), 3, 3), Error);
}

// A half-plane whose edge runs through texels: the parts tell how far in.
TEST(MaskDistance, PartsPlaceAnEdgeWithinTexels) {
  constexpr std::size_t n = 16, factor = 4;
  std::vector<std::uint8_t> fine(n * n * factor * factor, 0);
  // Material over 0 <= x < 8.25 texels.
  for (std::size_t i = 0; i < fine.size(); ++i) fine[i] = i % (n * factor) < 33 ? 1 : 0;
  const ViewMask view = view_mask(fine, n, n, factor);
  for (std::size_t i = 0; i < n * n; ++i) {
    const std::size_t x = i % n;
    const double centre = static_cast<double>(x) + 0.5;
    // Edges at 8.25 and at 0, which is 16 as well.
    const double inside = std::min(8.25 - centre, centre);
    const double outside = std::min(centre - 8.25, 16 - centre);
    const double expected = x < 8 ? inside : -outside;
    EXPECT_EQ(view.mask[i], x < 8 ? 1 : 0) << x;
    // In the texel of the edge, and where both edges are as near, the mean is not that of the
    // centre.
    if (x == 8) {
      EXPECT_LT(view.distance[i], 0);
      EXPECT_GT(view.distance[i], -0.5);
    } else if (x != 3 && x != 4 && x != 12) {
      EXPECT_NEAR(view.distance[i], expected, 1e-6) << x;
    }
  }
}

TEST(MaskDistance, SignsAreThoseOfTheMask) {
  constexpr std::size_t n = 9, factor = 4;
  const ViewMask view = view_mask(random_mask(n * n * factor * factor, 0.5, 8), n, n, factor);
  for (std::size_t i = 0; i < n * n; ++i) EXPECT_EQ(view.distance[i] > 0, view.mask[i] == 1);
}

TEST(MaskDistance, NormalizesAllViewsAlike) {
  std::vector<float> distances = {0.5f, -4, 2, infinity, -infinity, -0.5f};
  normalize_distances(distances);
  EXPECT_EQ(distances, (std::vector<float>{0.125f, -1, 0.5f, 1, -1, -0.125f}));
  std::vector<float> unbounded = {infinity, -infinity};
  normalize_distances(unbounded);
  EXPECT_EQ(unbounded, (std::vector<float>{1, -1}));
}

}  // namespace
}  // namespace weft::test
