// Decoding of Tucker models whatever their modes and ranks: in bulk, in runs of any length, and by
// look-ups; random models against the reference, between guard zones.
#include "weft/codecs/tucker_decoder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "codecs/random_lookups.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/tucker_sampler.hpp"
#include "weft/model/tucker.hpp"

namespace weft::test {
namespace {

struct Case {
  const char* merge;
  std::vector<std::size_t> ranks;  // of the groups' modes; a mode's size: no factor
};

// Views, lights, rows and columns about the vectors and the micro-tiles.
constexpr BtfShape shape{10, 11, 9, 17, 3};

// Texels' factors before the rows of lights and behind them, one of them or none, channels of their
// own, with the texels and with the lights.
const Case cases[] = {
    {"", {4, 3, 2, 5, 6}},    {"", {4, 3, 2, 8, 3}},    {"", {4, 3, 3, 5, 17}},
    {"", {4, 3, 2, 9, 6}},    {"", {4, 3, 3, 9, 17}},   {"", {4, 3, 2, 9, 17}},
    {"", {10, 3, 2, 5, 6}},   {"", {10, 3, 3, 9, 17}},  {"", {4, 11, 2, 5, 6}},
    {"", {10, 11, 3, 9, 17}}, {"", {10, 11, 1, 4, 17}}, {"", {4, 10, 2, 1, 2}},
    {"", {1, 1, 1, 1, 1}},    {"yxc", {5, 4, 459}},     {"yxc", {5, 9, 20}},
    {"yxc", {10, 10, 459}},   {"xc", {4, 3, 5, 20}},    {"xc", {4, 10, 9, 2}},
    {"yx", {4, 3, 2, 30}},    {"yx", {4, 3, 3, 153}},   {"lc", {4, 9, 5, 6}},
    {"lc", {4, 30, 2, 2}},    {"lc", {10, 9, 9, 17}},   {"lc", {4, 33, 5, 17}},
    {"vl", {20, 2, 5, 6}},    {"vl", {100, 2, 1, 2}},   {"vl,yxc", {17, 459}},
    {"vl,yx", {110, 2, 20}},  {"vlc", {20, 5, 6}},      {"vlc", {300, 1, 2}},
    {"vlc,yx", {33, 153}},
};

TuckerModel random_tucker(const Case& c, const BtfShape& size) {
  TuckerModel model;
  model.info.codec = "tucker";
  model.info.btf = make_info(size, DType::f16);
  model.set_groups(ModeGroups(size, c.merge));
  std::size_t count = 1;
  for (std::size_t n = 0; n < c.ranks.size(); ++n) {
    const std::size_t whole = model.ranks[n];
    count *= model.ranks[n] = c.ranks[n];
    if (c.ranks[n] < whole) model.factors[n] = random_floats(whole * c.ranks[n], 10 + n, -1, 1);
  }
  model.core = random_floats(count, 5, -1, 1);
  return model;
}

std::string text_of(const Case& c) {
  std::string text = c.merge;
  for (const std::size_t rank : c.ranks) text += " " + std::to_string(rank);
  return text;
}

std::vector<float> decoded(const TuckerModel& model, std::size_t run) {
  Device& device = shared_device();
  const auto decoder = tucker_decoder(device, model);
  const BtfShape& size = model.info.btf.shape;
  std::vector<float> values;
  for (std::size_t first = 0; first < size.images(); first += run) {
    const std::size_t count = std::min(run, size.images() - first);
    GuardedBuffer out(device, count * size.image_values() * sizeof(float), "images");
    decoder->decode(first, count, out.buffer());
    const std::vector<float> part = out.values<float>();
    values.insert(values.end(), part.begin(), part.end());
    EXPECT_TRUE(out.intact());
  }
  return values;
}

void expect_decoded(const Case& c, const BtfShape& size, std::size_t run) {
  SCOPED_TRACE(text_of(c));
  const TuckerModel model = random_tucker(c, size);
  const Codec& codec = find_codec("tucker");
  std::vector<double> expected(size.values());
  codec.reference_decoder(model)->decode(0, size.images(), expected);
  EXPECT_TRUE(all_near(decoded(model, run), expected, codec.decode_tolerance(model)));
}

TEST(TuckerDecoder, FewTexels) {
  const BtfShape small{2, 3, 3, 2, 3};
  for (const Case& c :
       {Case{"", {1, 2, 2, 2, 1}}, Case{"yxc", {1, 2, 18}}, Case{"lc", {1, 4, 2, 1}}}) {
    expect_decoded(c, small, 6);
  }
}

TEST(TuckerDecoder, ModesAndRanks) {
  for (const Case& c : cases) expect_decoded(c, shape, shape.images());
}

TEST(TuckerDecoder, ChannelsOfAnyNumber) {
  for (const std::size_t channels : Sizes{1, 2, 5}) {
    const BtfShape size{3, 4, 8, 16, channels};
    expect_decoded({"", {2, 3, channels, 5, 6}}, size, 12);
    expect_decoded({"", {2, 3, 1, 5, 16}}, size, 12);
    if (channels > 1) expect_decoded({"lc", {2, 5, 3, 7}}, size, 12);
  }
}

// More views than share a pass over the core, and images that go through the factors in parts.
TEST(TuckerDecoder, BlocksOfViewsAndImages) {
  const BtfShape many{50, 12, 64, 48, 3};
  for (const Case& c : {Case{"yxc", {7, 5, 9216}}, Case{"", {7, 5, 2, 30, 20}},
                        Case{"", {7, 12, 2, 30, 20}}, Case{"lc", {7, 9, 30, 20}}}) {
    expect_decoded(c, many, 100);
  }
}

// Runs that begin and end anywhere give the same bits.
TEST(TuckerDecoder, RunsOfAnyLength) {
  for (const Case& c : cases) {
    SCOPED_TRACE(text_of(c));
    const TuckerModel model = random_tucker(c, shape);
    const std::vector<float> whole = decoded(model, shape.images());
    EXPECT_TRUE(all_equal(decoded(model, 7), whole));
  }
}

TEST(TuckerDecoder, HoldsNoMoreThanItSays) {
  for (const Case& c : cases) {
    SCOPED_TRACE(text_of(c));
    Device device("auto");
    const TuckerModel model = random_tucker(c, shape);
    Buffer out(device, shape.values() * sizeof(float), "images");
    const std::size_t before = device.allocated();
    tucker_decoder(device, model)->decode(0, shape.images(), out);
    device.finish();
    EXPECT_LE(device.peak_allocated() - before, tucker_decoder_bytes(model));
    const std::size_t peak = device.peak_allocated();
    const auto sampler = tucker_sampler(device, model);
    EXPECT_LE(device.allocated() - before, tucker_sampler_bytes(model));
    EXPECT_LE(device.peak_allocated(), std::max(peak, before + tucker_sampler_bytes(model)));
  }
}

// Single texels between measured ones: random taps and weights against decode_texel.
void expect_looked_up(const Case& c, const BtfShape& size, const LookupShape& lookup,
                      std::size_t count) {
  SCOPED_TRACE(text_of(c));
  Device& device = shared_device();
  const TuckerModel model = random_tucker(c, size);
  const Codec& codec = find_codec("tucker");
  Random random(5);
  const std::vector<std::uint32_t> records = random_lookups(lookup, size, count, random);
  std::vector<double> expected(count * size.channels);
  codec.reference_sampler(model)->look_up(lookup, records, expected);
  GuardedBuffer in(device, std::span<const std::uint32_t>(records), "records");
  GuardedBuffer out(device, expected.size() * sizeof(float), "values");
  tucker_sampler(device, model)->look_up(lookup, count, in.buffer(), out.buffer());
  EXPECT_TRUE(all_near(out.values<float>(), expected, lookup_tolerance(codec, model, lookup)));
  EXPECT_TRUE(out.intact());
}

TEST(TuckerSampler, SmallModels) {
  const BtfShape small{3, 11, 2, 3, 3};
  for (const LookupShape& lookup : {LookupShape{1, 1, 1}, LookupShape{4, 3, 3}}) {
    expect_looked_up({"", {2, 9, 2, 1, 2}}, small, lookup, 3);
    expect_looked_up({"lc", {2, 9, 1, 2}}, small, lookup, 3);
  }
}

TEST(TuckerSampler, ModesAndRanks) {
  for (const Case& c : cases) {
    expect_looked_up(c, shape, {1, 1, 1}, 65);
    expect_looked_up(c, shape, {4, 3, 3}, 65);
  }
}

// Ranks about whole vectors of either direction.
TEST(TuckerSampler, RanksAboutTheVector) {
  const BtfShape size{18, 40, 2, 3, 3};
  for (const std::size_t lights : Sizes{1, 7, 8, 9, 15, 16, 17, 31, 32, 33, 40}) {
    for (const std::size_t views : Sizes{1, 4, 5, 17, 18}) {
      expect_looked_up({"", {views, lights, 2, 2, 3}}, size, {1, 1, 1}, 40);
    }
    expect_looked_up({"", {5, lights, 2, 2, 3}}, size, {4, 3, 3}, 40);
  }
}

// More look-ups than are ordered at once: the same ones again and again give the same bits.
TEST(TuckerSampler, ManyTimesTheSame) {
  const BtfShape small{3, 4, 2, 3, 3};
  constexpr std::size_t some = 1000;
  constexpr std::size_t count = (std::size_t{1} << 20) + some;
  const LookupShape lookup{1, 1, 1};
  Device& device = shared_device();
  const TuckerModel model = random_tucker({"", {2, 3, 2, 1, 2}}, small);
  Random random(6);
  const std::vector<std::uint32_t> once = random_lookups(lookup, small, some, random);
  std::vector<std::uint32_t> records(count * lookup.words());
  for (std::size_t i = 0; i < records.size(); ++i) records[i] = once[i % once.size()];
  Buffer in(device, records.size() * sizeof(std::uint32_t), "records");
  device.write(in, std::span<const std::uint32_t>(records));
  std::vector<float> values(count * small.channels);
  Buffer out(device, values.size() * sizeof(float), "values");
  device.fill_zero(out, 0, out.size());
  tucker_sampler(device, model)->look_up(lookup, count, in, out);
  device.read(out, std::span<float>(values));
  const std::size_t period = some * small.channels;
  EXPECT_TRUE(std::equal(values.begin() + period, values.end(), values.begin()));
  EXPECT_TRUE(
      std::any_of(values.begin(), values.begin() + period, [](float value) { return value != 0; }));
}

}  // namespace
}  // namespace weft::test
