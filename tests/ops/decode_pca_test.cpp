// Images from a PCA model, at sizes about the vector (8 or 16 texels), the panel of three, the
// block of 4 panels by 16 images that one work-item decodes, and at ranks about the panel.
#include "weft/ops/decode_pca.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <ostream>
#include <vector>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/pca.hpp"

namespace weft::test {
namespace {

PcaModel random_model(std::size_t images, std::size_t texels, std::size_t channels,
                      std::size_t rank, double size = 1.0) {
  PcaModel model;
  model.info.btf.shape = {images, 1, 1, texels, channels};
  model.rank = rank;
  model.mean = random_floats(images * channels, 1, -size, size);
  model.coefficients = random_floats(texels * rank, 2, -1.0, 1.0);
  model.basis = random_floats(rank * images * channels, 3, -size, size);
  return model;
}

std::vector<float> decode(const PcaModel& model, std::size_t first, std::size_t count) {
  Device& device = shared_device();
  const BtfShape& shape = model.info.btf.shape;
  // At rank 0 there is nothing in A and B; the kernel must not look there.
  std::vector<float> A = panels_of(transpose(model.coefficients, shape.texels(), model.rank),
                                   model.rank, shape.texels(), ops::panel_width(device), 0.0f);
  std::vector<float> B = transpose(model.basis, model.rank, model.mean.size());
  A.resize(std::max<std::size_t>(A.size(), 1), unused);
  B.resize(std::max<std::size_t>(B.size(), 1), unused);
  GuardedBuffer a(device, std::span<const float>(A), "A");
  GuardedBuffer b(device, std::span<const float>(B), "B");
  GuardedBuffer mean(device, std::span<const float>(model.mean), "mean");
  GuardedBuffer out(device, count * shape.image_values() * sizeof(float), "images");
  ops::decode_pca(device, {first, count, shape.texels(), shape.channels, model.rank}, a.buffer(),
                  b.buffer(), mean.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(a.intact());
  EXPECT_TRUE(b.intact());
  EXPECT_TRUE(mean.intact());
  return values;
}

// rank products added to the mean one by one.
void expect_decoded(const PcaModel& model, std::size_t first, std::size_t count) {
  const BtfShape& shape = model.info.btf.shape;
  SCOPED_TRACE(testing::Message() << "images " << first << " to " << first + count << " of "
                                  << shape.texels() << " texels, " << shape.channels
                                  << " channels, rank " << model.rank);
  std::vector<double> expected(count * shape.image_values());
  reference::decode_pca(model, first, count, expected);
  PcaModel size;
  size.info.btf.shape = shape;
  size.rank = model.rank;
  for (const float value : model.mean) size.mean.push_back(std::abs(value));
  for (const float value : model.coefficients) size.coefficients.push_back(std::abs(value));
  for (const float value : model.basis) size.basis.push_back(std::abs(value));
  std::vector<double> magnitude(expected.size());
  reference::decode_pca(size, first, count, magnitude);
  const double unit = gamma(static_cast<double>(model.rank) + 1, float_roundoff);
  EXPECT_TRUE(all_near(decode(model, first, count), expected,
                       [&](std::size_t i) { return unit * magnitude[i]; }));
}

TEST(DecodePca, SmallOfEachShape) {
  for (const std::size_t channels : Sizes{1, 2, 3}) {
    expect_decoded(random_model(3, 27, channels, 2), 1, 2);
  }
}

TEST(DecodePca, StraddlesVectorsPanelsAndBlocks) {
  for (const std::size_t channels : Sizes{1, 2, 3, 4, 5}) {
    for (const std::size_t texels : Sizes{1,  7,  8,  9,  15, 16, 17, 23, 24, 25, 31, 32,
                                          33, 39, 40, 41, 47, 48, 49, 95, 96, 97, 193}) {
      expect_decoded(random_model(3, texels, channels, 5), 0, 3);
    }
    for (const std::size_t images : Sizes{1, 15, 16, 17, 33}) {
      expect_decoded(random_model(images, 50, channels, 3), 0, images);
    }
  }
}

TEST(DecodePca, AnyRank) {
  for (const std::size_t channels : Sizes{1, 2, 3, 5}) {
    for (const std::size_t rank : Sizes{0, 1, 23, 24, 25, 64}) {
      expect_decoded(random_model(2, 49, channels, rank), 0, 2);
    }
  }
}

TEST(DecodePca, AnyRunOfImagesGivesTheSameBits) {
  for (const std::size_t channels : Sizes{1, 3, 4}) {
    const PcaModel model = random_model(40, 60, channels, 7);
    const std::vector<float> all = decode(model, 0, 40);
    for (const std::size_t count : Sizes{1, 3, 16, 19}) {
      for (std::size_t first = 0; first + count <= 40; first += count) {
        const auto begin = all.begin() + static_cast<std::ptrdiff_t>(first * 60 * channels);
        EXPECT_TRUE(same_bits(
            decode(model, first, count),
            std::vector<float>(begin, begin + static_cast<std::ptrdiff_t>(count * 60 * channels))));
      }
    }
    expect_decoded(model, 17, 5);
  }
}

// Images behind others leave those alone.
TEST(DecodePca, SmallBehindOtherImages) {
  Device& device = shared_device();
  const PcaModel model = random_model(4, 27, 3, 2);
  const std::size_t image = 27 * 3;
  GuardedBuffer a(device,
                  std::span<const float>(panels_of(transpose(model.coefficients, 27, 2), 2, 27,
                                                   ops::panel_width(device), 0.0f)),
                  "A");
  GuardedBuffer b(device, std::span<const float>(transpose(model.basis, 2, model.mean.size())),
                  "B");
  GuardedBuffer mean(device, std::span<const float>(model.mean), "mean");
  GuardedBuffer out(device, std::span<const float>(std::vector<float>(5 * image, 7.0f)), "images");
  ops::decode_pca(device, {1, 2, 27, 3, 2, 2}, a.buffer(), b.buffer(), mean.buffer(), out.buffer());
  std::vector<float> expected(5 * image, 7.0f);
  const std::vector<float> images = decode(model, 1, 2);
  std::copy(images.begin(), images.end(), expected.begin() + 2 * static_cast<long>(image));
  EXPECT_TRUE(same_bits(out.values<float>(), expected));
  EXPECT_TRUE(out.intact());
}

TEST(DecodePca, AnyMagnitude) {
  for (const double size : {1e-30, 1e30}) expect_decoded(random_model(2, 30, 3, 10, size), 0, 2);
}

}  // namespace
}  // namespace weft::test
