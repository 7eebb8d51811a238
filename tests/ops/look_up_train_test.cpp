// Look-ups in tensor trains and tensors with their modes in another order, between guard zones.
#include "weft/ops/look_up_train.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/permute.hpp"
#include "weft/reference/lookup.hpp"
#include "weft/tensor/permute.hpp"

namespace weft::test {
namespace {

TtModel random_train(const BtfShape& shape, const char* order,
                     const std::array<std::size_t, mode_count + 1>& ranks, bool absolute = false) {
  TtModel model;
  model.info.btf = make_info(shape);
  model.order = parse_order(order, "--order");
  model.ranks = ranks;
  for (std::size_t n = 0; n < mode_count; ++n) {
    model.cores[n] = random_floats(ranks[n] * model.size(n) * ranks[n + 1], 11 + n, -1, 1);
    for (float& value : model.cores[n]) value = absolute ? std::abs(value) : value;
  }
  return model;
}

// Random records; every third has the texel of the one before, as sorted ones do.
std::vector<std::uint32_t> random_records(const LookupShape& lookup, const BtfShape& shape,
                                          std::size_t count) {
  Random random(5);
  std::vector<std::uint32_t> records;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t before = records.size();
    for (std::size_t t = 0; t < lookup.texels; ++t) {
      const bool again = i % 3 != 0;
      records.push_back(again ? records[before - lookup.words() + t]
                              : static_cast<std::uint32_t>(random.index(shape.texels())));
    }
    for (std::size_t v = 0; v < lookup.views; ++v) {
      records.push_back(static_cast<std::uint32_t>(random.index(shape.views)));
    }
    for (std::size_t l = 0; l < lookup.lights; ++l) {
      records.push_back(static_cast<std::uint32_t>(random.index(shape.lights)));
    }
    for (std::size_t w = 0; w < lookup.weights(); ++w) {
      records.push_back(std::bit_cast<std::uint32_t>(static_cast<float>(random.uniform())));
    }
  }
  return records;
}

std::vector<float> look_up(const TtModel& model, const LookupShape& lookup,
                           const std::vector<std::uint32_t>& records) {
  Device& device = shared_device();
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t count = records.size() / lookup.words();
  const ops::TrainCores cores(device, model);
  GuardedBuffer in(device, std::span<const std::uint32_t>(records), "records");
  GuardedBuffer out(device, count * shape.channels * sizeof(float), "values");
  ops::look_up_train(device, {lookup, shape, count, in.buffer(), out.buffer()}, cores);
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(in.intact());
  return values;
}

void expect_looked_up(const BtfShape& shape, const char* order,
                      const std::array<std::size_t, mode_count + 1>& ranks,
                      const LookupShape& lookup, std::size_t count) {
  SCOPED_TRACE(testing::Message() << order << ", " << lookup.texels << ' ' << lookup.views << ' '
                                  << lookup.lights << " taps, " << count);
  const TtModel model = random_train(shape, order, ranks);
  const TtModel size = random_train(shape, order, ranks, true);
  const std::vector<std::uint32_t> records = random_records(lookup, shape, count);
  std::vector<double> expected(count * shape.channels);
  std::vector<double> magnitude(expected.size());
  reference::texel_sampler(model)->look_up(lookup, records, expected);
  reference::texel_sampler(size)->look_up(lookup, records, magnitude);
  // A term goes through five products and the sums over four ranks and all taps.
  double terms = 10 + static_cast<double>(lookup.taps());
  for (const std::size_t rank : ranks) terms += static_cast<double>(rank);
  EXPECT_TRUE(all_near(look_up(model, lookup, records), expected,
                       [&](std::size_t i) { return gamma(terms, float_roundoff) * magnitude[i]; }));
}

constexpr const char* orders[]{"x,y,c,v,l", "v,x,c,l,y", "c,l,y,x,v", "l,y,v,x,c"};

TEST(LookUpTrain, SmallOfEachOrder) {
  for (const char* order : orders) {
    expect_looked_up({3, 4, 3, 5, 3}, order, {1, 2, 9, 3, 2, 1}, {1, 1, 1}, 3);
    expect_looked_up({3, 4, 3, 5, 3}, order, {1, 2, 3, 8, 2, 1}, {4, 3, 3}, 4);
  }
}

TEST(LookUpTrain, RanksAboutTheVectorAndFourOfThem) {
  for (const std::size_t rank : Sizes{1, 7, 8, 9, 31, 32, 33, 65}) {
    for (const char* order : orders) {
      expect_looked_up({4, 5, 6, 7, 3}, order, {1, 5, rank, rank, 4, 1}, {1, 1, 1}, 70);
    }
  }
}

TEST(LookUpTrain, TapsOfEveryGroup) {
  for (const char* order : orders) {
    // a program each
    expect_looked_up({4, 5, 6, 7, 1}, order, {1, 3, 10, 5, 2, 1}, {4, 1, 1}, 129);
    expect_looked_up({4, 5, 6, 7, 4}, order, {1, 3, 10, 5, 2, 1}, {1, 3, 1}, 129);
    expect_looked_up({4, 5, 6, 7, 3}, order, {1, 3, 10, 5, 2, 1}, {1, 1, 3}, 129);
    expect_looked_up({4, 5, 6, 7, 3}, order, {1, 3, 10, 5, 2, 1}, {4, 3, 3}, 129);
  }
}

// A look-up's bits do not depend on what was looked up before it.
TEST(LookUpTrain, BitsDependOnTheRecordAlone) {
  const BtfShape shape{4, 5, 6, 7, 3};
  for (const char* order : orders) {
    const TtModel model = random_train(shape, order, {1, 5, 20, 9, 4, 1});
    const LookupShape lookup{4, 3, 3};
    const std::vector<std::uint32_t> records = random_records(lookup, shape, 130);
    const std::vector<float> together = look_up(model, lookup, records);
    for (std::size_t i = 0; i < 130; i += 13) {
      const auto begin = records.begin() + static_cast<std::ptrdiff_t>(i * lookup.words());
      const std::vector<std::uint32_t> one(begin,
                                           begin + static_cast<std::ptrdiff_t>(lookup.words()));
      EXPECT_TRUE(all_equal(look_up(model, lookup, one),
                            std::span(together).subspan(i * shape.channels, shape.channels)));
    }
  }
}

TEST(Permute, SmallTensorsInEveryOrder) {
  Device& device = shared_device();
  for (const std::array<std::size_t, 3>& sizes :
       {std::array<std::size_t, 3>{1, 1, 1}, {3, 5, 2}, {2, 9, 17}}) {
    const std::vector<float> values = random_floats(sizes[0] * sizes[1] * sizes[2], 3);
    std::array<std::size_t, 3> axes{0, 1, 2};
    do {
      const std::array<std::size_t, 3> strides{sizes[1] * sizes[2], sizes[2], 1};
      const GuardedBuffer in(device, std::span<const float>(values), "in");
      GuardedBuffer out(device, (values.size() + 2) * sizeof(float), "out");
      device.fill_zero(out.buffer(), 0, 2 * sizeof(float));
      ops::permute(device, {sizes[axes[0]], sizes[axes[1]], sizes[axes[2]]},
                   {strides[axes[0]], strides[axes[1]], strides[axes[2]]}, in.buffer(), 2,
                   out.buffer());
      std::vector<float> expected = permuted(std::span<const float>(values), sizes, axes);
      expected.insert(expected.begin(), {0.0f, 0.0f});
      EXPECT_TRUE(all_equal(out.values<float>(), expected));
      EXPECT_TRUE(out.intact());
    } while (std::next_permutation(axes.begin(), axes.end()));
  }
}

}  // namespace
}  // namespace weft::test
