// Channels moved behind the texels: sizes about the vector and the work-item, any number of
// channels.
#include "weft/ops/turn_channels.hpp"

#include <gtest/gtest.h>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/shared_device.hpp"

namespace weft::test {
namespace {

void expect_turned(std::size_t images, std::size_t channels, std::size_t texels) {
  const std::vector<float> values = random_floats(images * channels * texels, 3);
  GuardedBuffer from(shared_device(), std::span<const float>(values), "channels first");
  GuardedBuffer to(shared_device(), values.size() * sizeof(float), "channels last");
  ops::turn_channels(shared_device(), images, channels, texels, from.buffer(), to.buffer());
  const std::vector<float> found = to.values<float>();
  EXPECT_TRUE(to.intact());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t p = i % texels;
    const std::size_t c = i / texels % channels;
    const std::size_t image = i / texels / channels;
    ASSERT_EQ(found[(image * texels + p) * channels + c], values[i])
        << images << " images, " << channels << " channels, " << texels << " texels, at " << i;
  }
}

TEST(TurnChannels, SmallImages) {
  for (const std::size_t channels : Sizes{1, 2, 3, 5}) {
    for (const std::size_t texels : Sizes{1, 7, 8, 9, 17}) expect_turned(2, channels, texels);
  }
}

TEST(TurnChannels, AboutTheWorkItem) {
  for (const std::size_t texels : Sizes{2047, 2048, 2049, 5000}) {
    expect_turned(3, 3, texels);
    expect_turned(1, 4, texels);
  }
}

}  // namespace
}  // namespace weft::test
