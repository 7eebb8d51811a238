// Device memory: limits, copies, views of host memory, sub-buffers, and our account of it all.
#include "weft/device/buffer.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/device/device.hpp"

namespace weft::test {
namespace {

std::vector<std::byte> counted_bytes(std::size_t count) {
  std::vector<std::byte> bytes(count);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::byte>(i * 7 + i / 251);
  return bytes;
}

TEST(Buffer, WriteReadAndFillTouchTheirRangeOnly) {
  Device device("auto");
  for (const std::size_t size : Sizes{1, 2, 127, 128, 129, 4096, 100003}) {
    SCOPED_TRACE(size);
    Buffer buffer(device, size, "buffer");
    EXPECT_EQ(buffer.size(), size);
    std::vector<std::byte> expected = counted_bytes(size);
    device.write(buffer, 0, expected);
    // the middle third anew, a piece of that zero
    const std::size_t third = size / 3;
    const std::vector<std::byte> middle(third, std::byte{0xC3});
    device.write(buffer, third, middle);
    std::copy(middle.begin(), middle.end(), expected.begin() + static_cast<std::ptrdiff_t>(third));
    const std::size_t zeros = third / 2;
    device.fill_zero(buffer, third + 1, zeros);
    std::fill_n(expected.begin() + static_cast<std::ptrdiff_t>(third + 1), zeros, std::byte{0});
    std::vector<std::byte> actual(size);
    device.read(buffer, 0, actual);
    EXPECT_EQ(actual, expected);
    // a part, from an odd offset
    std::vector<std::byte> part(size - size / 2);
    device.read(buffer, size / 2, part);
    EXPECT_TRUE(std::equal(part.begin(), part.end(),
                           expected.begin() + static_cast<std::ptrdiff_t>(size / 2)));
  }
}

TEST(Buffer, TypedCopiesCountInElements) {
  Device device("auto");
  Buffer buffer(device, 10 * sizeof(float), "buffer");
  std::vector<float> values(10);
  std::iota(values.begin(), values.end(), 1.0f);
  device.write(buffer, std::span<const float>(values));
  const std::vector<float> two{-1.0f, -2.0f};
  device.write(buffer, std::span<const float>(two), 4);
  std::vector<float> actual(3);
  device.read(buffer, std::span<float>(actual), 3);
  EXPECT_TRUE(all_equal(actual, std::vector<float>{4.0f, -1.0f, -2.0f}));
}

TEST(Buffer, CopiesOfNothingAreAllowed) {
  Device device("auto");
  Buffer buffer(device, 0, "nothing");
  EXPECT_EQ(buffer.size(), 0U);
  device.write(buffer, 0, std::span<const std::byte>());
  device.read(buffer, 0, std::span<std::byte>());
  device.fill_zero(buffer, 0, 0);
  device.finish();
}

TEST(Buffer, CopiesPastTheEndAreRefused) {
  Device device("auto");
  Buffer buffer(device, 16, "buffer");
  std::vector<std::byte> bytes(17);
  expect_error(ErrorKind::runtime, {"CL_INVALID_VALUE"}, [&] { device.write(buffer, 0, bytes); });
  expect_error(ErrorKind::runtime, {"CL_INVALID_VALUE"}, [&] { device.read(buffer, 0, bytes); });
  expect_error(ErrorKind::runtime, {"CL_INVALID_VALUE"},
               [&] { device.read(buffer, 16, std::span(bytes).first(1)); });
  expect_error(ErrorKind::runtime, {"CL_INVALID_VALUE"}, [&] { device.fill_zero(buffer, 8, 9); });
}

TEST(Buffer, BeyondTheLargestAllocationIsRefusedWithSizes) {
  Device device("auto");
  const std::size_t limit = device.limits().largest_allocation;
  for (const std::size_t bytes : Sizes{limit + 1, std::size_t{1} << 60, ~std::size_t{0}}) {
    expect_error(ErrorKind::runtime,
                 {"coefficients", std::to_string(bytes), "largest allocation", device.limits().name,
                  std::to_string(limit)},
                 [&] { Buffer buffer(device, bytes, "coefficients"); });
  }
  EXPECT_EQ(device.allocated(), 0U);
}

// A driver may let us allocate more than there is; our own account does not. (Memory that nobody
// touches costs nothing.)
TEST(Buffer, BeyondTheMemoryIsRefusedWithSizes) {
  Device device("auto");
  const std::size_t limit = device.limits().global_memory;
  const std::size_t step = device.limits().largest_allocation;
  std::vector<Buffer> buffers;
  while (device.allocated() + step <= limit) buffers.emplace_back(device, step, "step");
  const std::size_t used = device.allocated();
  EXPECT_EQ(used, buffers.size() * step);
  const std::size_t bytes = limit - used + 1;
  ASSERT_LE(bytes, step);
  expect_error(ErrorKind::runtime,
               {"last straw", std::to_string(bytes), std::to_string(used), device.limits().name,
                std::to_string(limit)},
               [&] { Buffer buffer(device, bytes, "last straw"); });
  EXPECT_EQ(device.allocated(), used);
  // what is given back can be had again
  buffers.pop_back();
  EXPECT_NO_THROW(Buffer(device, bytes - 1, "fits"));
}

TEST(Buffer, AccountFollowsBuffersThroughMoves) {
  Device device("auto");
  EXPECT_EQ(device.allocated(), 0U);
  {
    Buffer a(device, 1000, "a");
    Buffer b(device, 200, "b");
    EXPECT_EQ(device.allocated(), 1200U);
    Buffer c = std::move(a);
    EXPECT_EQ(device.allocated(), 1200U);
    EXPECT_EQ(c.size(), 1000U);
    // NOLINTBEGIN(bugprone-use-after-move,clang-analyzer-cplusplus.Move): they are empty then
    EXPECT_FALSE(a);
    EXPECT_EQ(a.size(), 0U);
    // NOLINTEND(bugprone-use-after-move,clang-analyzer-cplusplus.Move)
    b = std::move(c);
    EXPECT_EQ(device.allocated(), 1000U);
    Buffer& self = b;
    b = std::move(self);
    EXPECT_EQ(device.allocated(), 1000U);
    EXPECT_TRUE(b);
    std::swap(a, b);
    EXPECT_EQ(a.size(), 1000U);
    EXPECT_EQ(device.allocated(), 1000U);
    b = Buffer(device, 50, "d");
    EXPECT_EQ(device.allocated(), 1050U);
  }
  EXPECT_EQ(device.allocated(), 0U);
  EXPECT_EQ(device.peak_allocated(), 1200U);
}

TEST(Buffer, ViewsOfHostMemoryReadWhatIsThere) {
  Device device("auto");
  const std::vector<std::byte> host = counted_bytes(5000);
  // also from an odd address, as the data of a mapped file may lie
  for (const std::size_t offset : Sizes{0, 1, 3, 64}) {
    const auto part = std::span<const std::byte>(host).subspan(offset, 4099);
    const Buffer view = Buffer::wrap(device, part, "view");
    EXPECT_EQ(view.size(), part.size());
    std::vector<std::byte> actual(part.size());
    device.read(view, 0, actual);
    EXPECT_TRUE(std::equal(part.begin(), part.end(), actual.begin()));
  }
  // it is not the device's memory
  EXPECT_EQ(device.peak_allocated(), 0U);
}

// What is written to it is in the host's memory once it was read into the same place, and nothing
// beside.
TEST(Buffer, WritableViewsWriteToHostMemory) {
  Device device("auto");
  const std::vector<std::byte> expected = counted_bytes(4099);
  constexpr auto untouched = std::byte{0xA5};
  for (const std::size_t offset : Sizes{0, 1, 3, 64}) {
    std::vector<std::byte> host(4099 + 2 * 64, untouched);
    const auto part = std::span(host).subspan(offset, expected.size());
    Buffer view = Buffer::wrap_writable(device, part, "view");
    device.write(view, 0, expected);
    device.read(view, 0, part);
    for (std::size_t i = 0; i < host.size(); ++i) {
      const bool inside = i >= offset && i < offset + expected.size();
      ASSERT_EQ(host[i], inside ? expected[i - offset] : untouched) << offset << " " << i;
    }
  }
  EXPECT_EQ(device.peak_allocated(), 0U);
}

TEST(Buffer, PartsShareTheMemoryOfTheWhole) {
  Device device("auto");
  const std::size_t alignment = device.limits().alignment;
  const std::vector<std::byte> bytes = counted_bytes(4 * alignment);
  Buffer whole(device, bytes.size(), "whole");
  device.write(whole, 0, bytes);
  Buffer part = Buffer::part(device, whole, 2 * alignment, alignment + 1, "part");
  EXPECT_EQ(device.allocated(), whole.size());
  std::vector<std::byte> actual(part.size());
  device.read(part, 0, actual);
  EXPECT_TRUE(std::equal(actual.begin(), actual.end(),
                         bytes.begin() + static_cast<std::ptrdiff_t>(2 * alignment)));
  device.write(part, 1, std::vector<std::byte>{std::byte{0x5A}});
  std::vector<std::byte> one(1);
  device.read(whole, 2 * alignment + 1, one);
  EXPECT_EQ(one.front(), std::byte{0x5A});
}

TEST(Buffer, PartsThatDoNotFitAreRefused) {
  Device device("auto");
  const std::size_t alignment = device.limits().alignment;
  ASSERT_GT(alignment, 1U);
  const Buffer whole(device, 2 * alignment, "whole");
  expect_error(ErrorKind::runtime, {"stray", "CL_INVALID_VALUE"},
               [&] { Buffer::part(device, whole, alignment, alignment + 1, "stray"); });
  expect_error(ErrorKind::runtime, {"skewed", "CL_MISALIGNED_SUB_BUFFER_OFFSET"},
               [&] { Buffer::part(device, whole, 1, 1, "skewed"); });
}

}  // namespace
}  // namespace weft::test
