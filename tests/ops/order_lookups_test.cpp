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

// More than an order holds come in parts, each ordered by itself.
TEST(OrderLookups, Parts) {
  Device& device = shared_device();
  if (!device.limits().is_cpu) GTEST_SKIP() << "ordered on CPU devices only";
  constexpr std::size_t texels = 11;
  constexpr std::size_t part = std::size_t{1} << 20;
  constexpr std::size_t count = part + 1000;
  const LookupShape lookup{1, 1, 1};
  Random random(4);
  std::vector<std::uint32_t> records(count * lookup.words());
  for (std::uint32_t& word : records) word = static_cast<std::uint32_t>(random.index(texels));
  Buffer in(device, records.size() * sizeof(std::uint32_t), "records");
  device.write(in, std::span<const std::uint32_t>(records));
  Buffer out(device, sizeof(float), "values");
  ops::TexelOrder order(device, texels);
  std::size_t done = 0;
  order.for_each(
      {lookup, {1, 1, 1, texels, 1}, count, in, out}, [&](const ops::LookupBatch& batch) {
        ASSERT_EQ(batch.first, done);
        ASSERT_EQ(batch.count, done == 0 ? part : count - part);
        std::vector<std::uint32_t> found(batch.count);
        device.read(*batch.order, std::span<std::uint32_t>(found));
        const auto texel = [&](std::uint32_t i) {
          return records[(batch.first + i) * lookup.words()];
        };
        std::vector<std::uint32_t> expected(batch.count);
        std::iota(expected.begin(), expected.end(), 0U);
        std::stable_sort(expected.begin(), expected.end(),
                         [&](std::uint32_t a, std::uint32_t b) { return texel(a) < texel(b); });
        EXPECT_TRUE(found == expected);
        done += batch.count;
      });
  EXPECT_EQ(done, count);
}

}  // namespace
}  // namespace weft::test
