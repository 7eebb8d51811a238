// Blocks of texels of all images: every texel in its place, from mapped images and from others.
#include "weft/btf/texel_block.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

TEST(TexelBlock, HoldsTheTexelsOfEveryImage) {
  const BtfShape shape{9, 8, 5, 7, 3};  // 72 images: more than are released together
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const std::vector<std::byte> bytes = encode_values(random_values(shape.values(), 5), dtype);
    const std::size_t texel = shape.channels * size_of(dtype);
    for (const bool mapped : {true, false}) {
      MemorySource source(make_info(shape, dtype), bytes, mapped);
      for (const auto& [first, count] :
           {std::pair<std::size_t, std::size_t>{0, 35}, {0, 1}, {34, 1}, {11, 13}}) {
        std::vector<std::byte> block(shape.images() * count * texel);
        read_texels(source, first, count, block);
        for (std::size_t image = 0; image < shape.images(); ++image) {
          const auto expected =
              bytes.begin() + static_cast<std::ptrdiff_t>((image * shape.texels() + first) * texel);
          EXPECT_TRUE(std::equal(
              block.begin() + static_cast<std::ptrdiff_t>(image * count * texel),
              block.begin() + static_cast<std::ptrdiff_t>((image + 1) * count * texel), expected))
              << "image " << image << ", texels from " << first;
        }
      }
      std::vector<std::byte> block(shape.images() * texel);
      EXPECT_THROW(read_texels(source, 35, 1, block), Error);
      EXPECT_THROW(read_texels(source, 3, 2, block), Error);
      if (!mapped) {
        EXPECT_EQ(source.largest_read(), 1U);
      }
    }
  }
}

TEST(TexelBlock, GranuleIsBoundedAndNeverNothing) {
  for (const BtfShape& shape : {BtfShape{1, 1, 1, 1, 1}, BtfShape{1, 1, 4096, 4096, 3},
                                BtfShape{151, 151, 512, 512, 3}, BtfShape{30, 40, 128, 128, 3}}) {
    const std::size_t granule = texel_granule(shape);
    EXPECT_GE(granule, 1U);
    EXPECT_LE(granule, shape.texels());
    EXPECT_LE(granule * shape.images() * shape.channels * sizeof(float),
              std::max(std::size_t{8} << 20, std::min<std::size_t>(64, shape.texels()) *
                                                 shape.images() * shape.channels * sizeof(float)));
  }
}

}  // namespace
}  // namespace weft::test
