// Tucker models: written, read back bit for bit, decoded by hand, selected, refused where their
// tensors do not fit each other; ranks cut by what is lost.
#include "weft/model/tucker.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "model/lying_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/tucker_parts.hpp"
#include "weft/model/tucker_ranks.hpp"

namespace weft::test {
namespace {

// Random numbers in a model of the given ranks; those of a mode's size have no factor.
TuckerModel random_model(const BtfShape& shape, std::string_view merge,
                         const std::vector<std::size_t>& ranks, Storage storage = Storage::f16) {
  TuckerModel model;
  model.info.codec = "tucker";
  model.info.storage = storage;
  model.info.btf = make_info(shape, DType::f16);
  model.set_groups(ModeGroups(shape, merge));
  std::size_t count = 1;
  for (std::size_t n = 0; n < ranks.size(); ++n) {
    const std::size_t size = model.ranks[n];
    count *= ranks[n];
    model.ranks[n] = ranks[n];
    if (ranks[n] < size) model.factors[n] = random_floats(size * ranks[n], 10 + n, -1, 1);
  }
  model.core = random_floats(count, 5, -1, 1);
  round_to_storage(model);
  return model;
}

struct Shape {
  const char* merge;
  std::vector<std::size_t> ranks;
};
constexpr BtfShape shape{4, 3, 5, 6, 3};
const Shape shapes[] = {{"", {2, 2, 2, 3, 4}}, {"", {4, 3, 3, 5, 6}}, {"yxc", {3, 2, 90}},
                        {"yxc", {4, 2, 20}},   {"lc", {2, 5, 5, 3}},  {"xc", {3, 3, 2, 7}},
                        {"vl,yxc", {6, 90}},   {"vlc", {20, 5, 4}},   {"vl,yx", {7, 2, 30}}};

TEST(TuckerModel, ReadsBackTheBitsThatWereRounded) {
  for (const Shape& s : shapes) {
    for (const Storage storage : {Storage::f16, Storage::f32}) {
      const TuckerModel model = random_model(shape, s.merge, s.ranks, storage);
      const TemporaryFolder folder;
      const std::size_t size = write_model(folder / "m.weft", model);
      EXPECT_EQ(size, model_file_size(model));
      const auto found = TuckerModel::read(ModelFile(folder / "m.weft"));
      EXPECT_EQ(found->groups.merge(), model.groups.merge());
      EXPECT_EQ(found->ranks, model.ranks);
      EXPECT_EQ(found->core, model.core);
      EXPECT_EQ(found->factors, model.factors);
    }
  }
}

TEST(TuckerModel, DecodesByTheFormula) {
  for (const Shape& s : shapes) {
    SCOPED_TRACE(s.merge);
    const TuckerModel model = random_model(shape, s.merge, s.ranks);
    const std::vector<std::size_t> sizes = model.groups.sizes();
    std::vector<double> out(3);
    for (const auto& [v, l, y, x] : std::vector<std::array<std::size_t, 4>>{
             {0, 0, 0, 0}, {3, 2, 4, 5}, {1, 0, 3, 2}, {2, 1, 0, 5}}) {
      model.decode_texel(v, l, y, x, out);
      for (std::size_t c = 0; c < 3; ++c) {
        const std::array<std::size_t, mode_count> at{v, l, y, x, c};
        // every entry of the core times one entry of every factor
        double sum = 0;
        for (std::size_t i = 0; i < model.core.size(); ++i) {
          double term = double{model.core[i]};
          std::size_t rest = i;
          for (std::size_t n = sizes.size(); n-- > 0;) {
            const std::size_t r = rest % model.ranks[n];
            rest /= model.ranks[n];
            std::size_t row = 0;
            for (const Mode mode : model.groups.groups()[n].modes) {
              row = row * mode_size(shape, mode) + at[index_of(mode)];
            }
            term *= model.has_factor(n) ? double{model.factors[n][row * model.ranks[n] + r]}
                                        : (row == r ? 1.0 : 0.0);
          }
          sum += term;
        }
        EXPECT_NEAR(out[c], sum, 1e-12 * static_cast<double>(model.core.size()));
      }
    }
  }
}

TEST(TuckerModel, CountsOperations) {
  // 61 x 27 bases of whole texels: 27 sums of 61 products, then one of 27, for each channel
  const TuckerModel textures = random_model({81, 81, 2, 2, 3}, "yxc", {61, 27, 12});
  EXPECT_EQ(textures.texel_operations(), 3U * (27 * (2 * 61 - 1) + 2 * 27 - 1));
  // five modes: y and x and v and l are left of 2 x 4 x 3 x 5 by one, then three channels of 2
  const TuckerModel five = random_model({6, 4, 8, 7, 3}, "", {4, 3, 2, 5, 2});
  EXPECT_EQ(five.texel_operations(), 2 * 2 * 3 * 4 * (2U * 5 - 1) + 2 * 2 * 3 * (2U * 4 - 1) +
                                         2 * 2 * (2U * 3 - 1) + 2 * (2U * 2 - 1) +
                                         3 * (2U * 2 - 1));
}

TEST(TuckerModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TuckerModel model = random_model(shape, "yxc", {3, 2, 90});
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { TuckerModel::read(ModelFile(path)); });
  };
  // tensors: modes, core, factor.v, factor.l
  expect_refused({"m.weft", "core", "[270, 2]"}, [](LyingModel& m) { m.list[1].shape = {270, 2}; });
  expect_refused({"m.weft", "factor.v", "[4, 3]", "[4, 540]"}, [](LyingModel& m) {
    m.list[1].shape = {540, 1, 1};
  });
  expect_refused({"m.weft", "factor.v", "[4, 3]"}, [](LyingModel& m) {
    m.list[1].shape = {2, 3, 90};
    m.list[2].shape = {4, 3};
  });
  expect_refused({"m.weft", "factor.v", "mode v"},
                 [](LyingModel& m) { m.list.erase(m.list.begin() + 2); });
  expect_refused({"m.weft", "no tensor \"core\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin() + 1); });
  expect_refused({"m.weft", "no tensor \"modes\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin()); });
  expect_refused({"m.weft", "codec", "vq"}, [](LyingModel& m) { m.info.codec = "vq"; });
  using Numbers = std::array<std::uint8_t, mode_count>;
  for (const Numbers& numbers :
       {Numbers{1, 0, 2, 2, 2}, Numbers{0, 1, 2, 3, 0}, Numbers{0, 0, 1, 0, 0},
        Numbers{0, 1, 2, 2, 9}, Numbers{0, 2, 1, 1, 1}, Numbers{0, 1, 1, 1, 1}}) {
    expect_refused({"m.weft", "modes"},
                   [&](LyingModel& m) { m.list[0].values = std::as_bytes(std::span(numbers)); });
  }
}

std::vector<double> texels_of(const TuckerModel& model) {
  const BtfShape& size = model.info.btf.shape;
  std::vector<double> values(size.values());
  for (std::size_t i = 0; i < values.size(); i += size.channels) {
    const std::size_t p = i / size.channels % size.texels();
    const std::size_t image = i / size.image_values();
    model.decode_texel(image / size.lights, image % size.lights, p / size.width, p % size.width,
                       std::span(values).subspan(i, size.channels));
  }
  return values;
}

TEST(TuckerParts, ExpandedModesDecodeAlike) {
  for (const Shape& s : shapes) {
    SCOPED_TRACE(s.merge);
    const TuckerModel model = random_model(shape, s.merge, s.ranks);
    const std::vector<double> values = texels_of(model);
    for (const ModeGroup& group : model.groups.groups()) {
      const auto larger = expanded(model, group.name);
      EXPECT_FALSE(larger->has_factor(model.groups.find(group.name, "")));
      // the core is rounded to float again
      EXPECT_TRUE(
          all_near(texels_of(*larger), values, 1e-6 * static_cast<double>(model.core.size())));
    }
  }
  expect_error(ErrorKind::input, {"--expand y", "v, l, yxc"}, [] {
    expanded(random_model(shape, "yxc", {3, 2, 90}), "y");
  });
}

TEST(TuckerParts, RanksAreCutModeByMode) {
  TuckerModel model = random_model(shape, "", {3, 3, 2, 5, 4}, Storage::f32);
  model.info.parameters =
      R"({"merge":"","ranks":{"v":3,"l":3,"c":2,"y":5,"x":4},"factors_error":0.1,"discarded":0.2})";
  const auto less = with_ranks(model, "v=2,x=1");
  EXPECT_EQ(less->info.parameters, R"({"merge":"","ranks":{"v":2,"l":3,"c":2,"y":5,"x":1}})");
  EXPECT_EQ(less->ranks, (std::vector<std::size_t>{2, 3, 2, 5, 1}));
  EXPECT_EQ(less->factors[2], model.factors[2]);
  EXPECT_EQ(less->core[0], model.core[0]);
  EXPECT_EQ(less->core[1], model.core[4]);
  expect_error(ErrorKind::input, {"--ranks v=4", "3"}, [&] { with_ranks(model, "v=4"); });
  expect_error(ErrorKind::input, {"--ranks l=2", "whole"}, [&] { with_ranks(model, "l=2"); });
  expect_error(ErrorKind::input, {"--ranks v", "MODE=RANK"}, [&] { with_ranks(model, "v"); });
  expect_error(ErrorKind::input, {"--ranks q=1"}, [&] { with_ranks(model, "q=1"); });
  expect_error(ErrorKind::input, {"v=1,v=2", "twice"}, [&] { with_ranks(model, "v=1,v=2"); });
}

// Images between directions are the same combinations of the images at them.
TEST(TuckerParts, DirectionsBetweenMeasuredOnes) {
  const std::vector<DirectionWeights> views{{{1, 3, 0}, {0.5, 0.25, 0.25}, 1.0},
                                            {{2, 2, 2}, {1, 0, 0}, 1.0}};
  const std::vector<DirectionWeights> lights{{{0, 1, 2}, {0.125, 0.5, 0.375}, 0.5}};
  BtfInfo info = make_info({2, 1, shape.height, shape.width, shape.channels}, DType::f16);
  for (const Shape& s : shapes) {
    SCOPED_TRACE(s.merge);
    const TuckerModel model = random_model(shape, s.merge, s.ranks);
    const std::vector<double> measured = texels_of(model);
    const std::vector<double> between = texels_of(*at_directions(model, info, views, lights));
    const std::size_t image = shape.image_values();
    for (std::size_t v = 0; v < 2; ++v) {
      for (std::size_t i = 0; i < image; ++i) {
        double sum = 0;
        for (std::size_t a = 0; a < 3; ++a) {
          for (std::size_t b = 0; b < 3; ++b) {
            sum += views[v].weight[a] * lights[0].weight[b] * 0.5 *
                   measured[(views[v].index[a] * 3 + lights[0].index[b]) * image + i];
          }
        }
        ASSERT_NEAR(between[v * image + i], sum, 1e-6 * static_cast<double>(model.core.size()));
      }
    }
  }
}

TEST(TuckerRanks, CutWhereLeastIsLostPerByte) {
  // slices of the second mode are nearly empty; the goal is to lose no more than 0.1
  const std::vector<std::size_t> sizes{2, 3};
  const std::vector<float> core{3, 0.2f, 0.1f, 2, 0.2f, 0.1f};
  const TuckerBytes bytes{4, 0, sizes, {1, 1}};
  RankChoice choice = cut_ranks(core, sizes, bytes, {0.15, 0});
  EXPECT_EQ(choice.ranks, (std::vector<std::size_t>{2, 1}));
  EXPECT_NEAR(choice.lost, 0.1, 1e-6);
  // by bytes, down to the least there is
  choice = cut_ranks(core, sizes, bytes, {0, 1});
  EXPECT_EQ(choice.ranks, (std::vector<std::size_t>{1, 1}));
  EXPECT_NEAR(choice.lost, 4.1, 1e-6);
  // a mode without a factor keeps its rank
  choice = cut_ranks(core, sizes, {4, 0, sizes, {1, 0}}, {100, 0});
  EXPECT_EQ(choice.ranks, (std::vector<std::size_t>{1, 3}));
  EXPECT_EQ(leading_part(core, sizes, std::vector<std::size_t>{2, 1}), (std::vector<float>{3, 2}));
  EXPECT_EQ(leading_columns(core, 3, 2), (std::vector<float>{3, 0.2f, 2, 0.2f}));
  const std::vector<double> spectrum{5, 2, 0.5, -1e-9};
  EXPECT_EQ(rank_within(spectrum, 0.4), 3U);
  EXPECT_EQ(rank_within(spectrum, 0.5), 2U);
  EXPECT_EQ(rank_within(spectrum, 100), 1U);
  EXPECT_EQ(tail(spectrum, 1), 2.5);
}

}  // namespace
}  // namespace weft::test
