// Nested code-books on the device against the reference: images in bulk, texels between measured
// directions, and texels at directions themselves, at the seams of onion slices too.
#include "weft/ops/decode_vq.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>
#include <vector>

#include "codecs/random_lookups.hpp"
#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/vq_decoder.hpp"
#include "weft/reference/lookup.hpp"

namespace weft::test {
namespace {

using Vector = std::array<float, 3>;

const OnionSizes some_sizes[] = {{8, 4, 5, 6}, {1, 3, 2, 7}, {5, 1, 1, 2}, {2, 2, 3, 1}};

VqModel onion_model(const OnionSizes& sizes, const BtfShape& shape) {
  return random_vq(shape, {VqGrid::Kind::onion, sizes}, small_sizes, 4);
}

std::vector<float> decode(const VqModel& model, std::size_t first, std::size_t images) {
  Device& device = shared_device();
  const ops::VqTables tables(device, model);
  GuardedBuffer entries(device, ops::vq_entry_floats(tables, images) * sizeof(float), "entries");
  GuardedBuffer out(device, images * model.info.btf.shape.image_values() * sizeof(float), "images");
  ops::decode_vq(device, tables, first, images, entries.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(entries.intact());
  EXPECT_TRUE(out.intact());
  return values;
}

void expect_images(const VqModel& model, std::size_t first, std::size_t images) {
  SCOPED_TRACE(testing::Message() << model.sizes.p4 << " entries, " << model.info.btf.shape.texels()
                                  << " texels, " << model.info.btf.shape.channels << " channels");
  std::vector<double> expected(images * model.info.btf.shape.image_values());
  vq_reference_decoder(model)->decode(first, images, expected);
  EXPECT_TRUE(all_near(decode(model, first, images), expected, vq_decode_tolerance(model)));
}

// Texels and entries of P4 about the block of 64 that a work-item decodes.
TEST(DecodeVq, Images) {
  for (const std::size_t size : Sizes{1, 63, 64, 65, 130}) {
    VqModel::Sizes sizes = small_sizes;
    sizes.p4 = size;
    const BtfShape shape{5, 6, 1, 194 - size, 3};
    expect_images(random_vq(shape, {VqGrid::Kind::onion, {8, 4, 5, 6}}, sizes, 1), 0, 30);
    expect_images(random_vq(shape, VqGrid::measured(shape), sizes, 2), 7, 11);
  }
}

TEST(DecodeVq, SmallImages) {
  for (const std::size_t channels : Sizes{1, 3}) {
    const BtfShape shape{3, 2, 1, 3, channels};
    expect_images(onion_model({4, 3, 3, 4}, shape), 1, 4);
    expect_images(random_vq(shape, VqGrid::measured(shape), small_sizes, 2), 0, 6);
  }
}

// Some channels of all, in any order.
TEST(DecodeVq, SmallChannels) {
  const BtfShape shape{3, 2, 1, 3, 2};
  VqModel model = onion_model({4, 3, 3, 4}, {3, 2, 1, 3, 4});
  model.info.btf.shape = shape;
  model.channels = {3, 0};
  expect_images(model, 0, 6);
}

std::vector<float> look_up(DeviceSampler& sampler, const LookupShape& lookup, const BtfShape& shape,
                           std::span<const std::uint32_t> records) {
  const std::size_t count = records.size() / lookup.words();
  GuardedBuffer lookups(shared_device(), records, "look-ups");
  GuardedBuffer out(shared_device(), count * shape.channels * sizeof(float), "values");
  sampler.look_up(lookup, count, lookups.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(lookups.intact());
  return values;
}

// Between the places of measured directions.
void expect_indexed_lookups(const OnionSizes& sizes, std::size_t count) {
  for (const std::size_t channels : Sizes{1, 3}) {
    const BtfShape shape{7, 9, 3, 4, channels};
    const VqModel model = onion_model(sizes, shape);
    const auto sampler = vq_sampler(shared_device(), model);
    Random random(11);
    for (const LookupShape& lookup : {LookupShape{1, 1, 1}, LookupShape{4, 3, 3}}) {
      const std::vector<std::uint32_t> records = random_lookups(lookup, shape, count, random);
      std::vector<double> expected(count * channels);
      reference::texel_sampler(model)->look_up(lookup, records, expected);
      EXPECT_TRUE(all_near(look_up(*sampler, lookup, shape, records), expected,
                           lookup_tolerance(find_codec("vq"), model, lookup)));
    }
  }
}

TEST(LookUpVq, BetweenMeasuredDirections) {
  for (const OnionSizes& sizes : some_sizes) expect_indexed_lookups(sizes, 130);
}

TEST(LookUpVq, SmallBetweenMeasuredDirections) {
  expect_indexed_lookups({4, 3, 3, 4}, 4);
}

struct Pair {
  Vector view, light;
};

// At the zenith and on the horizon, at the poles of the slices, where phi goes round, and below the
// horizon; of lengths other than 1.
std::vector<Pair> seams() {
  const float tiny = 0x1p-40f;
  return {{{0, 0, 1}, {0, 0, 1}},
          {{0, 0, 2}, {1, 0, 0}},
          {{1, 0, 0}, {0, 1, 0}},
          {{0.5f, 0, 0.5f}, {0, -3, 0}},
          {{1, 0, 0.5f}, {-1, 0, 0}},
          {{1, -tiny, 1}, {0.3f, 0.2f, 0.9f}},
          {{1, tiny, 1}, {0.3f, 0.2f, 0.9f}},
          {{-1, 0, 1}, {0.3f, -0.2f, 0.9f}},
          {{-1, -tiny, 1}, {0.3f, -0.2f, 0.9f}},
          {{1, -0.3f, 0.2f}, {0.7f, 0.7f, -0.5f}},
          {{0.3f, 0.4f, -1}, {0.2f, 0.9f, 0.01f}},
          {{0, 0, -1}, {0, 0, -1}},
          {{tiny, -tiny, 1}, {0.1f, -0.8f, 0.4f}}};
}

std::vector<Pair> some_pairs(std::size_t count) {
  std::vector<Pair> pairs = seams();
  Random random(8);
  while (pairs.size() < count) {
    Pair pair;
    const auto size = static_cast<float>(random.uniform(0.5, 2));
    pair.view = direction_from_degrees(random.uniform(0, 90), random.uniform(0, 360));
    pair.light = direction_from_degrees(random.uniform(0, 90), random.uniform(0, 360));
    for (float& x : pair.view) x *= size;
    pairs.push_back(pair);
  }
  pairs.resize(count);
  return pairs;
}

std::vector<std::uint32_t> direction_records(std::size_t texels, const BtfShape& shape,
                                             std::span<const Pair> pairs) {
  Random random(21);
  std::vector<std::uint32_t> records;
  for (const Pair& pair : pairs) {
    for (std::size_t t = 0; t < texels; ++t) {
      records.push_back(static_cast<std::uint32_t>(random.index(shape.texels())));
    }
    for (const Vector& d : {pair.view, pair.light}) {
      for (const float x : d) records.push_back(std::bit_cast<std::uint32_t>(x));
    }
    if (texels == 1) continue;
    for (std::size_t t = 0; t < texels; ++t) {
      records.push_back(std::bit_cast<std::uint32_t>(t == 2 ? 0.5f : t == 1 ? 0.0f : 0.25f));
    }
  }
  return records;
}

void expect_direction_lookups(const OnionSizes& sizes, std::size_t texels, std::size_t channels,
                              std::size_t count) {
  SCOPED_TRACE(testing::Message() << sizes.phi << ' ' << sizes.theta << ' ' << sizes.alpha << ' '
                                  << sizes.beta << ", " << texels << " texels, " << channels
                                  << " channels, " << count);
  const BtfShape shape{3, 2, 3, 4, channels};
  const VqModel model = onion_model(sizes, shape);
  const LookupShape lookup{texels, 1, 1, true};
  const std::vector<Pair> pairs = some_pairs(count);
  const std::vector<std::uint32_t> records = direction_records(texels, shape, pairs);
  EXPECT_NO_THROW(validate_lookups(lookup, shape, records));
  std::vector<double> expected(count * channels);
  reference::texel_sampler(model)->look_up(lookup, records, expected);
  const auto sampler = vq_sampler(shared_device(), model);
  // values lie in [0, 1]: a step between nodes changes them by no more
  const double tolerance = lookup_tolerance(find_codec("vq"), model, lookup);
  EXPECT_TRUE(all_near(look_up(*sampler, lookup, shape, records), expected, [&](std::size_t i) {
    return tolerance + place_error(sizes, pairs[i / channels].view, pairs[i / channels].light);
  }));
}

TEST(LookUpVq, Directions) {
  for (const OnionSizes& sizes : some_sizes) {
    for (const std::size_t count : Sizes{1, 63, 64, 65, 193}) {
      expect_direction_lookups(sizes, 4, 3, count);
    }
    expect_direction_lookups(sizes, 1, 1, 100);
  }
}

TEST(LookUpVq, SmallDirections) {
  expect_direction_lookups({4, 3, 3, 4}, 4, 3, 5);
  expect_direction_lookups({4, 3, 3, 4}, 1, 1, 14);
}

// Directions that are nodes of the grid have the values of these nodes.
TEST(LookUpVq, DirectionsAtNodes) {
  const OnionSizes sizes{8, 4, 5, 6};
  const BtfShape shape{3, 2, 3, 4, 3};
  const VqModel model = onion_model(sizes, shape);
  const OnionSlices slices(sizes);
  const std::vector<Direction> views = slices.views();
  std::vector<std::uint32_t> records;
  std::vector<double> expected;
  std::vector<Pair> pairs;
  std::vector<double> values(3);
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (v % sizes.theta == 0) continue;  // of no azimuth
    const std::vector<Direction> lights = slices.lights(v / sizes.theta);
    for (std::size_t l = 0; l < lights.size(); ++l) {
      if (slices.at_pole(l % sizes.beta)) continue;  // of no alpha
      pairs.push_back({views[v], lights[l]});
      const std::size_t p = pairs.size() % shape.texels();
      records.push_back(static_cast<std::uint32_t>(p));
      for (const Vector& d : {views[v], lights[l]}) {
        for (const float x : d) records.push_back(std::bit_cast<std::uint32_t>(x));
      }
      VqPlace place;
      const std::array<std::size_t, 4> node{v / sizes.theta, v % sizes.theta, l / sizes.beta,
                                            l % sizes.beta};
      for (std::size_t i = 0; i < 4; ++i) place[i] = {node[i], node[i], 0};
      model.entry_values(model.p6.entries[p], place, values);
      values[0] *= double{model.p6.scales[p]};
      expected.insert(expected.end(), values.begin(), values.end());
    }
  }
  const LookupShape lookup{1, 1, 1, true};
  const double tolerance = lookup_tolerance(find_codec("vq"), model, lookup);
  const auto sampler = vq_sampler(shared_device(), model);
  // the nodes themselves are rounded to float once
  EXPECT_TRUE(all_near(look_up(*sampler, lookup, shape, records), expected, [&](std::size_t i) {
    return tolerance + 2 * place_error(sizes, pairs[i / 3].view, pairs[i / 3].light);
  }));
}

// Decoded by the whole of a codec, with a colour transform behind it: linear ones are inverted on
// what is interpolated between texels, others on each texel.
TEST(LookUpVq, SmallDirectionsUnderColourTransforms) {
  const OnionSizes sizes{4, 3, 3, 4};
  const BtfShape shape{3, 2, 3, 4, 3};
  const Codec& codec = find_codec("vq");
  const LookupShape lookup{4, 1, 1, true};
  const std::size_t count = is_simulator(shared_device()) ? 5 : 150;
  const std::vector<Pair> pairs = some_pairs(count);
  const std::vector<std::uint32_t> records = direction_records(4, shape, pairs);
  for (const auto kind : {ColourTransform::Kind::ycrcb, ColourTransform::Kind::log}) {
    VqModel model = onion_model(sizes, shape);
    model.info.colour_transform = {kind, 1, 2, {}, {}};
    std::vector<double> expected(count * 3);
    codec.reference_sampler(model)->look_up(lookup, records, expected);
    // by the definition
    std::vector<double> texel(3), sums(3);
    const Lookup last(lookup, std::span(records).last(lookup.words()));
    for (std::size_t t = 0; t < 4; ++t) {
      model.fitted_texel_at(last.view(), last.light(), last.texels[t] / 4, last.texels[t] % 4,
                            texel);
      model.info.colour_transform.invert(texel);
      for (std::size_t c = 0; c < 3; ++c) sums[c] += last.texel_weight(t) * texel[c];
    }
    EXPECT_TRUE(all_near(std::span(expected).last(3), sums, 1e-12));
    const auto sampler = codec.sampler(shared_device(), model);
    EXPECT_TRUE(all_near(look_up(*sampler, lookup, shape, records), expected, [&](std::size_t i) {
      return lookup_tolerance(codec, model, lookup) +
             inverted_error(model.info.colour_transform, 3,
                            place_error(sizes, pairs[i / 3].view, pairs[i / 3].light));
    }));
  }
}

TEST(LookUpVq, RefusesDirectionsOfMeasuredGrids) {
  const BtfShape shape{5, 6, 3, 4, 3};
  const VqModel model = random_vq(shape, VqGrid::measured(shape), small_sizes, 3);
  EXPECT_FALSE(model.takes_directions());
  const auto sampler = vq_sampler(shared_device(), model);
  const std::vector<std::uint32_t> records(7);
  expect_error(ErrorKind::input, {"directions", "measured"}, [&] {
    look_up(*sampler, {1, 1, 1, true}, shape, records);
  });
  expect_error(ErrorKind::input, {"3 views", "one of each"}, [&] {
    validate({4, 3, 1, true}, shape, true);
  });
  expect_error(ErrorKind::input, {"look-up 0", "view (0, 0, 0)", "no direction"}, [&] {
    validate_lookups({1, 1, 1, true}, shape, records);
  });
}

}  // namespace
}  // namespace weft::test
