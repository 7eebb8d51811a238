// Look-ups in sparse tensor decompositions, the texels' lists merged and one by one, between guard
// zones.
#include "weft/ops/look_up_sparse.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <vector>

#include "model/random_sparse.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/sparse_decoder.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/lookup.hpp"

namespace weft::test {
namespace {

// Neighbours have texels in common, as at edges, and weights of zero.
std::vector<std::uint32_t> random_records(const LookupShape& lookup, const BtfShape& shape,
                                          std::size_t count) {
  Random random(5);
  std::vector<std::uint32_t> records;
  const auto add = [&](std::size_t taps, std::size_t limit) {
    const std::size_t first = records.size();
    for (std::size_t t = 0; t < taps; ++t) {
      records.push_back(t > 0 && random.index(4) == 0
                            ? records[first]
                            : static_cast<std::uint32_t>(random.index(limit)));
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    add(lookup.texels, shape.texels());
    add(lookup.views, shape.views);
    add(lookup.lights, shape.lights);
    for (std::size_t w = 0; w < lookup.weights(); ++w) {
      const double weight = random.index(5) == 0 ? 0.0 : random.uniform();
      records.push_back(std::bit_cast<std::uint32_t>(static_cast<float>(weight)));
    }
  }
  return records;
}

std::vector<std::uint32_t> indices_of(const IndexTensor& tensor) {
  std::vector<std::uint32_t> indices;
  for (std::size_t i = 0; i < tensor.size(); ++i) {
    indices.push_back(static_cast<std::uint32_t>(tensor[i]));
  }
  return indices;
}

template <typename T>
GuardedBuffer guarded(std::vector<T> values, const char* what) {
  if (values.empty()) values.resize(1);
  return {shared_device(), std::span<const T>(values), what};
}

std::vector<float> look_up(const SparseModel& model, const LookupShape& lookup,
                           const std::vector<std::uint32_t>& records, ops::TexelLists lists) {
  Device& device = shared_device();
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t count = records.size() / lookup.words();
  GuardedBuffer buffers[] = {
      guarded(ops::lookup_rows(indices_of(model.views.atoms), model.views.coefficients,
                               model.views.length),
              "lists of views"),
      guarded(ops::end_lists(indices_of(model.texels.atoms), model.texels.length),
              "atoms of texels"),
      guarded(ops::end_lists(model.texels.coefficients, model.texels.length),
              "coefficients of texels"),
      guarded(
          ops::lookup_dictionary(model.light_atoms, shape.lights, shape.channels, model.dictionary),
          "dictionary"),
      guarded(model.mean, "mean"),
      guarded(records, "records"),
  };
  GuardedBuffer out(device, count * shape.channels * sizeof(float), "values");
  ops::look_up_sparse(device, {lookup, shape, count, buffers[5].buffer(), out.buffer()},
                      {model.light_atoms, model.views.length, model.texels.length},
                      buffers[0].buffer(), {buffers[1].buffer(), buffers[2].buffer()},
                      buffers[3].buffer(), buffers[4].buffer(), lists);
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  for (GuardedBuffer& buffer : buffers) EXPECT_TRUE(buffer.intact());
  return values;
}

void expect_looked_up(const SparseModel& model, const LookupShape& lookup, std::size_t count,
                      ops::TexelLists lists = ops::TexelLists::one_by_one) {
  const BtfShape& shape = model.info.btf.shape;
  SCOPED_TRACE(testing::Message() << lookup.texels << ' ' << lookup.views << ' ' << lookup.lights
                                  << " taps, " << count << ", " << shape.channels
                                  << " channels, k1 " << model.views.length << ", k2 "
                                  << model.texels.length);
  const std::vector<std::uint32_t> records = random_records(lookup, shape, count);
  std::vector<double> expected(count * shape.channels);
  reference::texel_sampler(model)->look_up(lookup, records, expected);
  const SparseModel size = magnitude_of(model);
  std::vector<double> magnitude(expected.size());
  reference::texel_sampler(size)->look_up(lookup, records, magnitude);
  // Per term: the lights that its atom is blended of, the terms of its list, those of the texels
  // and their views, lights, views and texels of the mean, and three weights.
  const std::size_t terms = lookup.texels * model.texels.length * lookup.views +
                            model.views.length + lookup.lights + lookup.views + lookup.texels + 12;
  const double unit = gamma(static_cast<double>(terms), float_roundoff);
  EXPECT_TRUE(all_near(look_up(model, lookup, records, lists), expected,
                       [&](std::size_t i) { return unit * magnitude[i]; }));
}

TEST(LookUpSparse, SmallOfEachShape) {
  for (const std::size_t channels : Sizes{1, 3, 5}) {
    const SparseModel model = random_sparse({4, 5, 3, 4, channels}, {9, 8, 3, 4});
    expect_looked_up(model, {4, 3, 3}, 5);
    expect_looked_up(model, {4, 3, 1}, 5);
    expect_looked_up(model, {4, 3, 3}, 5, ops::TexelLists::merged);
  }
}

TEST(LookUpSparse, EachShapeAboutTheBlock) {
  const SparseModel model = random_sparse({4, 5, 6, 7, 3}, {30, 20, 5, 7});
  for (const std::size_t texels : Sizes{1, 4}) {
    for (const std::size_t views : Sizes{1, 3}) {
      for (const std::size_t lights : Sizes{1, 3}) {
        expect_looked_up(model, {texels, views, lights}, 70);
      }
    }
  }
  for (const std::size_t count : Sizes{1, 63, 64, 65, 129}) {
    expect_looked_up(model, {4, 3, 3}, count);
  }
  expect_looked_up(model, {4, 3, 3}, 70, ops::TexelLists::merged);
  expect_looked_up(model, {1, 3, 3}, 70, ops::TexelLists::merged);
}

TEST(LookUpSparse, AnyLengths) {
  for (const std::size_t k : Sizes{0, 1, 17}) {
    expect_looked_up(random_sparse({3, 4, 3, 5, 3}, {20, 20, k, 4}), {4, 3, 3}, 30);
    expect_looked_up(random_sparse({3, 4, 3, 5, 3}, {20, 20, 4, k}), {4, 3, 3}, 30);
  }
  expect_looked_up(random_sparse({3, 4, 3, 5, 3}, {0, 0, 0, 0}), {4, 3, 3}, 30);
}

// About whole vectors of atoms, and those that are read term by term.
TEST(LookUpSparse, AnyDictionary) {
  for (const std::size_t atoms : Sizes{9, 16, 1024, 1025}) {
    expect_looked_up(random_sparse({3, 4, 3, 5, 3}, {atoms, 20, 4, 3}), {4, 3, 3}, 30);
  }
  for (const std::size_t channels : Sizes{1, 5}) {
    expect_looked_up(random_sparse({3, 4, 3, 5, channels}, {1100, 300, 4, 3}), {4, 3, 1}, 30);
  }
}

// The single look-ups of a model of any lengths keep to its own bound.
TEST(LookUpSparse, ModelsKeepToTheBoundOfTheCodec) {
  const LookupShape single{1, 1, 1};
  for (const SparseSizes& sizes : {SparseSizes{1000, 40, 1, 1}, SparseSizes{1000, 40, 8, 8}}) {
    const SparseModel model = random_sparse({3, 4, 3, 5, 3}, sizes);
    const std::vector<std::uint32_t> records = random_records(single, model.info.btf.shape, 15);
    std::vector<double> expected(15 * 3);
    reference::texel_sampler(model)->look_up(single, records, expected);
    EXPECT_TRUE(all_near(look_up(model, single, records, ops::TexelLists::one_by_one), expected,
                         6 * sparse_decode_tolerance(model)));
  }
}

}  // namespace
}  // namespace weft::test
