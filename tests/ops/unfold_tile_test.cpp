// Raw texels as tensors: every type, channels last and first, whole tiles and blocks of texels.
#include "weft/ops/unfold_tile.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "ops/tiles.hpp"
#include "support/guarded_buffer.hpp"

namespace weft::test {
namespace {

void expect_unfolded(std::size_t images, std::size_t texels, std::size_t channels, DType dtype,
                     std::size_t first, std::size_t count) {
  const Tile tile = random_tile(images, texels, channels, dtype, 3);
  const GuardedBuffer raw = guarded_raw(tile);
  for (const bool channels_first : {false, true}) {
    GuardedBuffer out(shared_device(), images * count * channels * sizeof(float), "tensor");
    ops::unfold_tile(shared_device(),
                     {images, texels, first, count, channels, dtype, false, channels_first},
                     raw.buffer(), 0.5f, out.buffer());
    const std::vector<float> found = out.values<float>();
    EXPECT_TRUE(out.intact());
    for (std::size_t image = 0; image < images; ++image) {
      for (std::size_t p = 0; p < count; ++p) {
        for (std::size_t c = 0; c < channels; ++c) {
          const std::size_t at = channels_first ? (image * channels + c) * count + p
                                                : (image * count + p) * channels + c;
          const double value = tile.values[(image * texels + first + p) * channels + c];
          // 8-bit values are rounded once, when divided by 255
          ASSERT_EQ(found[at], 0.5f * static_cast<float>(value))
              << images << " images of " << texels << ", texel " << p << " channel " << c;
        }
      }
    }
  }
}

TEST(UnfoldTile, SmallTiles) {
  for (const DType dtype : raw_types) {
    for (const std::size_t channels : Sizes{1, 2, 3, 5}) {
      expect_unfolded(2, 9, channels, dtype, 0, 9);
      expect_unfolded(3, 9, channels, dtype, 4, 3);
    }
  }
}

TEST(UnfoldTile, AboutVectorsAndWorkItems) {
  for (const DType dtype : raw_types) {
    for (const std::size_t texels : Sizes{1, 7, 8, 9, 1023, 1024, 1025, 2500}) {
      expect_unfolded(3, texels, 3, dtype, 0, texels);
      expect_unfolded(2, texels + 5, 3, dtype, 3, texels);
    }
  }
}

TEST(UnfoldTile, NonFiniteValuesAsZero) {
  const std::vector<double> values{1, std::numeric_limits<double>::quiet_NaN(), 3,
                                   -std::numeric_limits<double>::infinity()};
  const Tile tile = tile_of(1, 4, 1, DType::f16, values);
  const GuardedBuffer raw = guarded_raw(tile);
  GuardedBuffer out(shared_device(), 4 * sizeof(float), "tensor");
  ops::unfold_tile(shared_device(), {1, 4, 0, 4, 1, DType::f16, true, false}, raw.buffer(), 1.0f,
                   out.buffer());
  EXPECT_EQ(out.values<float>(), (std::vector<float>{1, 0, 3, 0}));
}

}  // namespace
}  // namespace weft::test
