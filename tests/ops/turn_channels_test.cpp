// Channels moved behind the texels, with and without a factor, to images and to panels: sizes about
// the vector, the panel and the work-item, any number of channels.
#include "weft/ops/turn_channels.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft::test {
namespace {

// rank 0: no factor.
void expect_turned(std::size_t images, std::size_t channels, std::size_t texels,
                   std::size_t rank = 0) {
  SCOPED_TRACE(testing::Message() << images << " images, " << channels << " channels, " << texels
                                  << " texels, rank " << rank);
  Device& device = shared_device();
  const bool mixes = rank > 0;
  if (!mixes) rank = channels;
  constexpr std::size_t offset = 5;
  const std::vector<float> values = random_floats(offset + images * rank * texels, 3);
  const std::vector<float> factor = random_floats(channels * rank, 4);
  GuardedBuffer from(device, std::span<const float>(values), "channels first");
  GuardedBuffer U(device, std::span<const float>(factor), "factor");
  const std::size_t columns = texels * channels;
  GuardedBuffer to(device, (offset + images * columns) * sizeof(float), "channels last");
  GuardedBuffer panels(device, ops::packed_elements(device, images, columns) * sizeof(float),
                       "channels last in panels");
  const ops::ChannelsFirst turned{
      from.buffer(), offset, images, texels, channels, rank, mixes ? &U.buffer() : nullptr};
  ops::turn_channels(device, turned, to.buffer(), offset);
  ops::pack_channels(device, turned, panels.buffer());
  const std::vector<float> found = to.values<float>();
  const std::vector<float> packed = panels.values<float>();
  EXPECT_TRUE(to.intact());
  EXPECT_TRUE(panels.intact());
  const std::size_t width = ops::panel_width(device);
  for (std::size_t k = 0; k < images; ++k) {
    for (std::size_t j = 0; j < ops::round_up(columns, width); ++j) {
      const float in_panels = packed[(j / width * images + k) * width + j % width];
      if (j >= columns) {
        ASSERT_EQ(in_panels, 0.0f) << j;
        continue;
      }
      const std::size_t p = j / channels;
      const std::size_t c = j % channels;
      double wanted = 0;
      double size = 0;
      for (std::size_t r = 0; r < rank; ++r) {
        const double u = mixes ? double{factor[c * rank + r]} : (r == c ? 1.0 : 0.0);
        const double t = double{values[offset + (k * rank + r) * texels + p]};
        wanted += u * t;
        size += std::abs(u * t);
      }
      ASSERT_NEAR(in_panels, wanted, gamma(static_cast<double>(mixes ? rank : 0), 0x1p-24) * size)
          << j;
      ASSERT_EQ(in_panels, found[offset + k * columns + j]) << j;
    }
  }
}

TEST(TurnChannels, SmallImages) {
  for (const std::size_t channels : Sizes{1, 2, 3, 5}) {
    for (const std::size_t texels : Sizes{1, 7, 8, 9, 15, 16, 17, 33}) {
      expect_turned(2, channels, texels);
      expect_turned(2, channels, texels, channels > 1 ? channels - 1 : 1);
    }
  }
}

TEST(TurnChannels, AboutTheWorkItem) {
  for (const std::size_t texels : Sizes{255, 256, 257, 2047, 2048, 2049, 5000}) {
    expect_turned(3, 3, texels);
    expect_turned(1, 4, texels);
    expect_turned(2, 3, texels, 2);
  }
}

}  // namespace
}  // namespace weft::test
