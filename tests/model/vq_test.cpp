// Nested code-books: packed indices, equation 4 by its definition, between the nodes of onion
// slices too, files, parts, and files that lie.
#include "weft/model/vq.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>

#include "model/damage_model.hpp"
#include "model/lying_model.hpp"
#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/error.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

const BtfShape shape{5, 6, 3, 4, 3};
const OnionSizes onion{8, 4, 5, 6};

VqModel measured_model() {
  return random_vq(shape, VqGrid::measured(shape), small_sizes, 3);
}
VqModel onion_model() {
  return random_vq(shape, {VqGrid::Kind::onion, onion}, small_sizes, 4);
}

std::vector<std::uint32_t> bytes_of(const PackedIndices& packed) {
  std::vector<std::uint32_t> bytes;
  for (const std::byte byte : packed.bytes()) bytes.push_back(static_cast<std::uint32_t>(byte));
  return bytes;
}

TEST(PackedIndices, TakeTheBitsThatTheyNeed) {
  for (const auto& [limit, bits] : {std::pair<std::size_t, unsigned>{1, 1},
                                    {2, 1},
                                    {3, 2},
                                    {4, 2},
                                    {5, 3},
                                    {255, 8},
                                    {256, 8},
                                    {257, 9},
                                    {65536, 16},
                                    {65537, 17},
                                    {std::size_t{1} << 32, 32}}) {
    EXPECT_EQ(PackedIndices::bits(limit), bits) << limit;
    for (const std::size_t count : Sizes{0, 1, 7, 8, 9, 100}) {
      Random random(limit + count);
      std::vector<std::uint32_t> indices(count);
      for (std::uint32_t& i : indices) i = static_cast<std::uint32_t>(random.index(limit));
      if (count > 1) indices[1] = static_cast<std::uint32_t>(limit - 1);
      const PackedIndices packed(indices, limit);
      EXPECT_EQ(packed.bytes().size(), (count * bits + 7) / 8);
      const auto found = PackedIndices::unpack(bytes_of(packed), count, limit, "file");
      EXPECT_TRUE(std::equal(indices.begin(), indices.end(), found.indices().begin(),
                             found.indices().end()));
    }
  }
  // low bits first: 5, 6 and 1 of eight things
  EXPECT_EQ(bytes_of(PackedIndices({5, 6, 1}, 8)), (std::vector<std::uint32_t>{0b01110101, 0}));
}

TEST(PackedIndices, RefuseWhatIsNone) {
  const auto unpack = [](std::vector<std::uint32_t> bytes, std::size_t count, std::size_t limit) {
    return [=] { PackedIndices::unpack(bytes, count, limit, "m.weft: tensor \"P6\""); };
  };
  expect_error(ErrorKind::input, {"m.weft", "P6", "2 bytes for 2 indices of 3 bits"},
               unpack({1, 2}, 2, 5));
  expect_error(ErrorKind::input, {"m.weft", "P6", "index 5 of entry 1 is not below 5"},
               unpack({0b101001}, 2, 5));
  expect_error(ErrorKind::input, {"m.weft", "P6", "bits behind the last"}, unpack({64}, 2, 5));
}

// Equation 4 at the directions that were measured.
TEST(VqModel, ATexelIsAChainOfLookups) {
  const VqModel model = measured_model();
  std::vector<double> texel(3);
  for (std::size_t v = 0; v < shape.views; ++v) {
    for (std::size_t l = 0; l < shape.lights; ++l) {
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        model.fitted_texel(v, l, p / shape.width, p % shape.width, texel);
        const std::size_t k4 = model.p6.entries[p] * shape.views + v;
        const std::size_t k3 = model.p4.entries[k4];
        const std::size_t pair = model.p3.entries[k3];
        const std::size_t k2 = model.m[2 * pair];
        const double luminance = double{model.p6.scales[p]} * double{model.p4.scales[k4]} *
                                 double{model.p3.scales[k3]} * double{model.p2.scales[k2]} *
                                 double{model.p1[model.p2.entries[k2] * shape.lights + l]};
        EXPECT_NEAR(texel[0], luminance, 1e-12);
        const std::size_t colour = model.i1[model.i2[model.m[2 * pair + 1]] * shape.lights + l];
        EXPECT_EQ(texel[1], double{model.c[2 * colour]});
        EXPECT_EQ(texel[2], double{model.c[2 * colour + 1]});
      }
    }
  }
}

// Between nodes, values are interpolated linearly in each of the four directions.
TEST(VqModel, ValuesBetweenNodesAreInterpolated) {
  const VqModel model = onion_model();
  const std::size_t j = 2;
  const auto node = [&](std::array<std::size_t, 4> at) {
    VqPlace place;
    for (std::size_t i = 0; i < 4; ++i) place[i] = {at[i], at[i], 0};
    std::vector<double> values(3);
    model.entry_values(j, place, values);
    return values;
  };
  const VqPlace place{OnionStep{7, 0, 0.25}, OnionStep{1, 2, 0.5}, OnionStep{3, 4, 0.75},
                      OnionStep{0, 1, 0.125}};
  std::vector<double> expected(3, 0.0), found(3);
  for (std::size_t corner = 0; corner < 16; ++corner) {
    double weight = 1;
    std::array<std::size_t, 4> at{};
    for (std::size_t i = 0; i < 4; ++i) {
      const bool high = (corner >> i & 1) != 0;
      at[i] = high ? place[i].high : place[i].low;
      weight *= high ? place[i].fraction : 1 - place[i].fraction;
    }
    const std::vector<double> values = node(at);
    for (std::size_t c = 0; c < 3; ++c) expected[c] += weight * values[c];
  }
  model.entry_values(j, place, found);
  EXPECT_TRUE(all_near(found, expected, 1e-14));
}

TEST(VqModel, SurvivesItsFile) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    for (VqModel model : {measured_model(), onion_model()}) {
      model.info.storage = storage;
      round_to_storage(model);
      write_model(path, model);
      const auto found = VqModel::read(ModelFile(path));
      EXPECT_EQ(found->grid, model.grid);
      EXPECT_EQ(found->sizes, model.sizes);
      ASSERT_EQ(found->tensors().size(), model.tensors().size());
      for (std::size_t i = 0; i < model.tensors().size(); ++i) {
        const auto a = found->tensors()[i].values;
        const auto b = model.tensors()[i].values;
        EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << model.tensors()[i].name;
      }
    }
  }
}

// A part decodes to what the whole does there, and has no code-vector that it does not use.
TEST(VqModel, PartsKeepWhatTheyUse) {
  Selection selection;
  selection.views = {{4, 1}};
  selection.lights = {{0, 5, 2}};
  selection.region = Region{2, 1, 1, 2};
  selection.channels = {{2, 0}};
  for (const VqModel& model : {measured_model(), onion_model()}) {
    const auto part = model.select(selection);
    std::vector<double> whole(3), some(2);
    for (std::size_t v = 0; v < 2; ++v) {
      for (std::size_t l = 0; l < 3; ++l) {
        for (std::size_t y = 0; y < 2; ++y) {
          model.fitted_texel((*selection.views)[v], (*selection.lights)[l], y + 1, 2, whole);
          part->fitted_texel(v, l, y, 0, some);
          EXPECT_EQ(some[0], whole[2]);
          EXPECT_EQ(some[1], whole[0]);
        }
      }
    }
    EXPECT_LE(part->sizes.p4, 2U);
    EXPECT_LE(part->sizes.p3, model.sizes.p3);
    const auto again = part->select({});
    EXPECT_EQ(again->sizes, part->sizes);
    // what is between the directions of a part is interpolated
    EXPECT_FALSE(again->takes_directions());
    Selection texels;
    texels.region = selection.region;
    EXPECT_EQ(model.select(texels)->takes_directions(), model.takes_directions());
  }
}

TEST(VqModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const VqModel model = measured_model();
  const auto at = [&](std::string_view name) {
    const auto tensors = model.tensors();
    return static_cast<std::size_t>(
        std::find_if(tensors.begin(), tensors.end(),
                     [&](const ModelTensor& tensor) { return tensor.name == name; }) -
        tensors.begin());
  };
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const std::function<void(LyingModel&)>& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { VqModel::read(ModelFile(path)); });
  };
  const auto layout = [&](std::size_t word, std::uint32_t value) {
    std::vector<std::uint32_t> words(14);
    const auto bytes = model.tensors()[at("layout")].values;
    std::memcpy(words.data(), bytes.data(), bytes.size());
    words[word] = value;
    return words;
  };
  const auto expect_layout = [&](std::initializer_list<std::string_view> parts, std::size_t word,
                                 std::uint32_t value) {
    const std::vector<std::uint32_t> words = layout(word, value);
    expect_refused(parts, [&](LyingModel& m) {
      m.list[at("layout")].values = std::as_bytes(std::span(words));
    });
  };
  expect_layout({"m.weft", "layout", "grid 2"}, 0, 2);
  expect_layout({"m.weft", "layout", "of 5 measured views and 6 lights"}, 1, 4);
  expect_layout({"m.weft", "layout"}, 4, 0);
  expect_layout({"m.weft", "layout", "0 chromaticities"}, 5, 0);
  expect_layout({"m.weft", "layout", "without entries"}, 6, 0);
  expect_layout({"m.weft", "P1", "[7, 6]", "[9, 6]"}, 6, 9);
  expect_layout({"m.weft", "P2_scales"}, 7, 4000000000U);
  expect_layout({"m.weft", "M"}, 8, 40);
  expect_layout({"m.weft", "C", "[9, 2]"}, 11, 10);
  expect_layout({"m.weft", "I1"}, 12, 4000000000U);
  // the last index of an entry beyond its code-book: P6 has two bits for three entries
  const std::vector<std::uint8_t> beyond(3, 0xff);
  expect_refused({"m.weft", "P6", "index 3 of entry 0 is not below 3"}, [&](LyingModel& m) {
    m.list[at("P6")].values = std::as_bytes(std::span(beyond));
  });
  // M has bits for the larger of P2, of 5, and I2, of 3
  std::vector<std::uint32_t> pairs(model.m.indices().begin(), model.m.indices().end());
  pairs[1] = 4;
  const PackedIndices packed(pairs, 5);
  expect_refused({"m.weft", "M", "index 4 of entry 1 is not below 3"},
                 [&](LyingModel& m) { m.list[at("M")].values = packed.bytes(); });
  const std::vector<std::uint8_t> channels{0, 1, 3};
  expect_refused({"m.weft", "channels"}, [&](LyingModel& m) {
    m.list[at("channels")].values = std::as_bytes(std::span(channels));
  });
  expect_refused({"m.weft", "no tensor \"P4\""}, [&](LyingModel& m) {
    m.list.erase(m.list.begin() + static_cast<std::ptrdiff_t>(at("P4")));
  });
  expect_refused({"m.weft", "codec", "pca"}, [](LyingModel& m) { m.info.codec = "pca"; });
}

// Bytes changed under right checksums: an error that says so, or a model that can be decoded.
TEST(VqModel, DamagedFilesGiveErrorsOnly) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  Random random(21);
  std::size_t decoded = 0;
  for (const VqModel& model : {measured_model(), onion_model()}) {
    write_model(path, model);
    decoded += damage_and_open(path, 300, random, [&] {
      const auto found = VqModel::read(ModelFile(path));
      std::vector<double> texel(3);
      for (std::size_t x = 0; x < 4; ++x) found->decode_texel(1, 0, 2, x, texel);
    });
  }
  EXPECT_GT(decoded, 0U);
}

}  // namespace
}  // namespace weft::test
