// Images from sparse tensor decompositions, at sizes about the vector (8 or 16 images, and as many
// texels), about the block of 16 vectors of texels that one work-item decodes, and where a vector
// of images holds several views.
#include "weft/ops/decode_sparse.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "model/random_sparse.hpp"
#include "ops/matrices.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/sparse.hpp"

namespace weft::test {
namespace {

// A tensor of no values has a buffer of one, which nobody reads.
template <typename T>
std::vector<T> at_least_one(std::vector<T> values) {
  if (values.empty()) values.resize(1);
  return values;
}

std::vector<std::uint32_t> indices_of(const IndexTensor& tensor) {
  std::vector<std::uint32_t> indices;
  for (std::size_t i = 0; i < tensor.size(); ++i) {
    indices.push_back(static_cast<std::uint32_t>(tensor[i]));
  }
  return at_least_one(indices);
}

struct GuardedTerms {
  GuardedBuffer atoms;
  GuardedBuffer coefficients;
  GuardedTerms(Device& device, const SparseLists& lists)
      : atoms(device, std::span<const std::uint32_t>(indices_of(lists.atoms)), "atoms"),
        coefficients(device, std::span<const float>(at_least_one(lists.coefficients)),
                     "coefficients") {}
  bool intact() { return atoms.intact() && coefficients.intact(); }
};

std::vector<float> decode(const SparseModel& model, std::size_t first, std::size_t count) {
  Device& device = shared_device();
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t width = ops::vector_width(device);
  const ops::DecodeSparseShape sizes{first,
                                     count,
                                     shape.views,
                                     shape.lights,
                                     shape.texels(),
                                     shape.channels,
                                     model.light_atoms,
                                     model.abrdf_atoms,
                                     model.views.length,
                                     model.texels.length};
  GuardedTerms V(device, model.views);
  GuardedTerms P(device, model.texels);
  GuardedBuffer dictionary(
      device,
      std::span<const float>(at_least_one(ops::sparse_dictionary(width, sizes, model.dictionary))),
      "dictionary");
  GuardedBuffer mean(device, std::span<const float>(ops::sparse_mean(width, sizes, model.mean)),
                     "mean");
  GuardedBuffer abrdfs(
      device, std::max<std::size_t>(ops::sparse_abrdf_floats(width, sizes), 1) * sizeof(float),
      "ABRDFs");
  GuardedBuffer out(device, count * shape.image_values() * sizeof(float), "images");
  ops::decode_sparse(device, sizes, {V.atoms.buffer(), V.coefficients.buffer()},
                     {P.atoms.buffer(), P.coefficients.buffer()}, dictionary.buffer(),
                     mean.buffer(), abrdfs.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(abrdfs.intact());
  EXPECT_TRUE(dictionary.intact());
  EXPECT_TRUE(mean.intact());
  EXPECT_TRUE(V.intact());
  EXPECT_TRUE(P.intact());
  return values;
}

// k1 products in each of k2, added to the mean one by one.
void expect_decoded(const SparseModel& model, std::size_t first, std::size_t count) {
  const BtfShape& shape = model.info.btf.shape;
  SCOPED_TRACE(testing::Message() << "images " << first << " to " << first + count << " of "
                                  << shape.views << " x " << shape.lights << ", " << shape.texels()
                                  << " texels, " << shape.channels << " channels, k1 "
                                  << model.views.length << ", k2 " << model.texels.length);
  std::vector<double> expected(count * shape.image_values());
  reference::decode_sparse(model, first, count, expected);
  std::vector<double> magnitude(expected.size());
  reference::decode_sparse(magnitude_of(model), first, count, magnitude);
  const double terms = static_cast<double>(model.views.length + model.texels.length + 1);
  const double unit = gamma(terms, float_roundoff);
  EXPECT_TRUE(all_near(decode(model, first, count), expected,
                       [&](std::size_t i) { return unit * magnitude[i]; }));
}

TEST(DecodeSparse, SmallOfEachShape) {
  for (const std::size_t channels : Sizes{1, 2, 3}) {
    expect_decoded(random_sparse({2, 5, 1, 17, channels}, {6, 5, 3, 2}), 1, 8);
  }
}

TEST(DecodeSparse, StraddlesVectorsAndBlocks) {
  for (const std::size_t channels : Sizes{1, 2, 3, 4, 5}) {
    for (const std::size_t texels :
         Sizes{1, 7, 8, 9, 15, 16, 17, 23, 24, 25, 31, 32, 33, 127, 128, 129, 255, 256, 257, 300}) {
      expect_decoded(random_sparse({3, 2, 1, texels, channels}, {9, 7, 3, 4}), 0, 6);
    }
    for (const std::size_t lights : Sizes{1, 2, 7, 8, 9, 15, 16, 17, 33}) {
      expect_decoded(random_sparse({5, lights, 1, 20, channels}, {9, 7, 3, 4}), 0, 5 * lights);
    }
  }
}

TEST(DecodeSparse, AnyLengths) {
  for (const std::size_t k : Sizes{0, 1, 2, 8, 17, 32}) {
    expect_decoded(random_sparse({2, 9, 1, 40, 3}, {40, 50, k, 5}), 0, 18);
    expect_decoded(random_sparse({2, 9, 1, 40, 3}, {40, 50, 5, k}), 0, 18);
  }
  // data that is its mean
  expect_decoded(random_sparse({2, 9, 1, 40, 3}, {0, 0, 0, 0}), 0, 18);
}

TEST(DecodeSparse, LargeDictionaries) {
  expect_decoded(random_sparse({3, 7, 1, 40, 3}, {1000, 257, 5, 4}), 3, 11);
}

TEST(DecodeSparse, AnyRunOfImagesGivesTheSameBits) {
  for (const std::size_t channels : Sizes{1, 3, 4}) {
    const SparseModel model = random_sparse({4, 10, 6, 10, channels}, {20, 30, 7, 5});
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

TEST(DecodeSparse, AnyMagnitude) {
  for (const double size : {1e-30, 1e30}) {
    expect_decoded(random_sparse({2, 9, 1, 40, 3}, {20, 30, 7, 5}, size), 0, 18);
  }
}

}  // namespace
}  // namespace weft::test
