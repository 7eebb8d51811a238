// Entropy-coded numbers: round trips of every layout, and blobs that are none.
#include "weft/model/entropy_code.hpp"

#include <gtest/gtest.h>
#include <zstd.h>

#include <cmath>
#include <limits>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/largest_allocation.hpp"

namespace weft {
namespace {

using test::expect_error;

constexpr NumberType codes{2, true};

std::vector<std::int32_t> random_numbers(std::size_t count, std::int64_t least, std::int64_t most,
                                         std::uint64_t seed) {
  test::Random random(seed);
  std::vector<std::int32_t> numbers(count);
  for (std::int32_t& n : numbers) {
    n = static_cast<std::int32_t>(least + static_cast<std::int64_t>(random.index(
                                              static_cast<std::size_t>(most - least + 1))));
  }
  return numbers;
}

std::vector<std::int32_t> there_and_back(const std::vector<std::int32_t>& numbers, NumberType type,
                                         CodeLayout layout, Neighbours neighbours) {
  return entropy_decode(entropy_code(numbers, type, layout, neighbours), numbers.size(), type,
                        layout, neighbours, "blob");
}

TEST(EntropyCode, GivesBackEveryNumber) {
  for (const std::size_t count : test::Sizes{0, 1, 2, 3, 255, 1000, 70000}) {
    for (const Neighbours& neighbours :
         {Neighbours{1, 1}, Neighbours{1, 3}, Neighbours{5, 7}, Neighbours{1, 70000}}) {
      for (const int bits : {0, 1, 4, 8, 9, 15}) {
        const std::int64_t most = (std::int64_t{1} << bits) - 1;
        const auto numbers = random_numbers(count, -most, most, 3);
        for (const CodeLayout layout : {CodeLayout::planes, CodeLayout::classes}) {
          ASSERT_EQ(there_and_back(numbers, codes, layout, neighbours), numbers)
              << count << " numbers of " << bits << " bits, " << name_of(layout) << ", stride "
              << neighbours.stride;
        }
      }
      for (const std::size_t bytes : test::Sizes{1, 2, 4}) {
        const std::int64_t most = bytes == 4 ? std::numeric_limits<std::int32_t>::max()
                                             : (std::int64_t{1} << (8 * bytes)) - 1;
        const auto numbers = random_numbers(count, 0, most, 4);
        ASSERT_EQ(there_and_back(numbers, {bytes, false}, CodeLayout::planes, neighbours), numbers);
      }
    }
  }
}

TEST(EntropyCode, ExtremesAndTheirDifferences) {
  const std::vector<std::int32_t> numbers{-32767, 32767, -32767, 0, -1, 1, 32767, -32767};
  for (const CodeLayout layout : {CodeLayout::planes, CodeLayout::classes}) {
    EXPECT_EQ(there_and_back(numbers, codes, layout, {1, 8}), numbers);
    EXPECT_EQ(there_and_back(numbers, codes, layout, {2, 4}), numbers);
  }
}

TEST(EntropyCode, TakesLittleMoreThanTheEntropy) {
  // Laplace-distributed codes: about 1 + log2(2 e b / 2) bits each
  test::Random random(5);
  const double b = 9;
  std::vector<std::int32_t> numbers(200000);
  std::vector<double> counts(2000, 0);
  for (std::int32_t& n : numbers) {
    const double u = random.uniform() - 0.5;
    n = static_cast<std::int32_t>(
        std::lround(std::copysign(b * std::log(1 - 2 * std::abs(u) + 1e-12), -u)));
    ++counts[static_cast<std::size_t>(n + 1000)];
  }
  double entropy = 0;
  const auto total = static_cast<double>(numbers.size());
  for (const double count : counts) {
    if (count > 0) entropy -= count / total * std::log2(count / total);
  }
  for (const CodeLayout layout : {CodeLayout::planes, CodeLayout::classes}) {
    const double bits =
        8.0 * static_cast<double>(entropy_code(numbers, codes, layout, {}).size()) / total;
    EXPECT_GT(bits, entropy - 0.01);
    // a prefix code may waste up to a bit a symbol, and on so many symbols wastes much less
    EXPECT_LT(bits, entropy + 0.15) << name_of(layout);
  }
}

TEST(EntropyCode, BlobsThatAreNoneAreRefused) {
  const auto numbers = random_numbers(5000, -300, 300, 6);
  for (const CodeLayout layout : {CodeLayout::planes, CodeLayout::classes}) {
    const std::vector<std::byte> blob = entropy_code(numbers, codes, layout, {1, 10});
    const auto refused = [&](std::vector<std::byte> bytes, std::size_t count) {
      test::reset_largest_allocation();
      expect_error(ErrorKind::input, {"blob"}, [&] {
        entropy_decode(bytes, count, codes, layout, {1, 10}, "blob");
      });
      // what zstd takes for itself comes from malloc, and is bounded by the window
      EXPECT_LE(test::largest_allocation(), std::size_t{1} << 17);
    };
    for (std::size_t size = 0; size < blob.size(); size += 1 + size / 5) {
      refused({blob.begin(), blob.begin() + static_cast<std::ptrdiff_t>(size)}, numbers.size());
    }
    refused(blob, numbers.size() - 1);
    refused(blob, numbers.size() + 1);
    refused(blob, 0);
    refused(blob, std::size_t{1} << 40);
    std::vector<std::byte> longer = blob;
    longer.push_back(std::byte{0});
    refused(longer, numbers.size());
    refused(std::vector<std::byte>(100, std::byte{7}), 100);
    refused({}, 1);
    // one frame too many
    std::vector<std::byte> more = blob;
    for (int i = 0; i < 2; ++i) more.insert(more.end(), blob.begin(), blob.end());
    refused(more, numbers.size());
  }
  // lengths beyond those of two bytes
  const std::vector<std::byte> lengths(10, std::byte{17});
  std::vector<std::byte> frame(ZSTD_compressBound(lengths.size()));
  frame.resize(ZSTD_compress(frame.data(), frame.size(), lengths.data(), lengths.size(), 1));
  frame.resize(frame.size() + 22);
  expect_error(ErrorKind::input, {"blob", "17 bits"},
               [&] { entropy_decode(frame, 10, codes, CodeLayout::classes, {}, "blob"); });
}

}  // namespace
}  // namespace weft
