// Look-ups in the order of their texels: every record once, those of a texel as they come.
#include "weft/ops/order_lookups.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/shared_device.hpp"

namespace weft::test {
namespace {

void expect_ordered(std::size_t texels, std::size_t count, const LookupShape& lookup) {
  SCOPED_TRACE(testing::Message() << count << " look-ups in " << texels << " texels");
  Device& device = shared_device();
  Random random(3);
  std::vector<std::uint32_t> records(count * lookup.words());
  for (std::uint32_t& word : records) word = static_cast<std::uint32_t>(random.index(texels));
  GuardedBuffer in(device, std::span<const std::uint32_t>(records), "records");
  GuardedBuffer out(device, sizeof(float), "values");
  const BtfShape shape{1, 1, 1, texels, 1};
  std::vector<std::uint32_t> found;
  ops::TexelOrder order(device, texels);
  order.for_each({lookup, shape, count, in.buffer(), out.buffer()},
                 [&](const ops::LookupBatch& batch) {
                   EXPECT_EQ(batch.first, 0U);
                   EXPECT_EQ(batch.count, count);
                   if (!batch.order) return;
                   found.resize(count);
                   device.read(*batch.order, std::span<std::uint32_t>(found));
                 });
  EXPECT_TRUE(in.intact());
  EXPECT_TRUE(out.intact());
  if (!device.limits().is_cpu || count < texels) {
    EXPECT_TRUE(found.empty());
    return;
  }
  std::vector<std::uint32_t> expected(count);
  std::iota(expected.begin(), expected.end(), 0U);
  std::stable_sort(expected.begin(), expected.end(), [&](std::uint32_t a, std::uint32_t b) {
    return records[a * lookup.words()] < records[b * lookup.words()];
  });
  EXPECT_EQ(found, expected);
}

TEST(OrderLookups, SmallBatches) {
  for (const std::size_t count : Sizes{1, 6, 7, 8, 40}) expect_ordered(7, count, {1, 1, 1});
  expect_ordered(1, 5, {4, 3, 3});
}

TEST(OrderLookups, ManyOfFewTexelsAndFewOfMany) {
  expect_ordered(3, 1000, {4, 1, 3});
  expect_ordered(1000, 999, {1, 3, 1});
  expect_ordered(1000, 5000, {1, 1, 1});
}

}  // namespace
}  // namespace weft::test
