// Clustered tensor models: written, read back bit for bit, decoded by hand, selected, expanded,
// refused where their tensors do not fit each other.
#include "weft/model/kcta.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "model/lying_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/view_grid.hpp"
#include "weft/btf/weights.hpp"
#include "weft/model/kcta_parts.hpp"
#include "weft/model/storage.hpp"
#include "weft/reference/kcta.hpp"

namespace weft::test {
namespace {

struct Shape {
  const char* merge;
  std::size_t mode;
  std::vector<std::size_t> ranks;   // those of a mode's size have no factor
  std::vector<std::size_t> global;  // groups
};
constexpr BtfShape shape{5, 3, 4, 6, 3};
constexpr std::size_t clusters = 4;
const Shape shapes[] = {{"lc", 0, {2, 4, 3, 4}, {1}}, {"lc", 0, {2, 4, 3, 4}, {}},
                        {"lc", 1, {2, 3, 4, 5}, {0}}, {"", 0, {2, 2, 2, 3, 4}, {1, 3}},
                        {"", 4, {5, 2, 3, 3, 2}, {}}, {"yxc", 0, {3, 2, 20}, {2}},
                        {"vl", 0, {2, 2, 4, 6}, {}},  {"", 2, {3, 2, 1, 3, 4}, {0, 1}}};

// Random numbers in a model of such a shape.
KctaModel random_model(const Shape& s, std::size_t mixtures, Storage storage = Storage::f16) {
  KctaModel model;
  model.info.codec = "kcta";
  model.info.storage = storage;
  model.info.btf = make_info(shape, DType::f16);
  model.set_groups(ModeGroups(shape, s.merge), s.mode);
  model.clusters = std::min(clusters, model.slices());
  model.mixtures = std::min(mixtures, model.clusters);
  std::size_t core = 1;
  for (std::size_t n = 0; n < s.ranks.size(); ++n) {
    const std::size_t size = model.ranks[n];
    core *= s.ranks[n];
    model.ranks[n] = s.ranks[n];
    if (n == s.mode || s.ranks[n] == size) continue;
    const bool global = std::find(s.global.begin(), s.global.end(), n) != s.global.end();
    (global ? model.global : model.local)[n] =
        random_floats((global ? 1 : model.clusters) * size * s.ranks[n], 10 + n, -1, 1);
  }
  model.cores = random_floats(model.clusters * core, 5, -1, 1);
  Random random(7);
  std::vector<std::uint32_t> members;
  for (std::size_t i = 0; i < model.slices(); ++i) {
    std::vector<std::uint32_t> all{0, 1, 2, 3};
    all.resize(model.clusters);
    while (all.size() > model.mixtures) {
      all.erase(all.begin() + static_cast<std::ptrdiff_t>(random.index(all.size())));
    }
    members.insert(members.end(), all.begin(), all.end());
  }
  model.members = IndexTensor(members, model.clusters);
  model.mixing = random_floats(members.size() * model.ranks[model.mode], 6, -1, 1);
  round_to_storage(model);
  return model;
}

// The same with a grid of 3 x 3 views, of which none is in the last cluster.
KctaModel with_grid(KctaModel model) {
  model.grid_side = 3;
  std::vector<std::uint32_t> members;
  for (std::size_t e = 0; e < 9; ++e) {
    for (std::uint32_t k = 0; k < model.mixtures; ++k) members.push_back(k + e % 2);
  }
  model.grid_members = IndexTensor(members, model.clusters);
  model.grid_mixing = random_floats(members.size() * model.ranks[model.mode], 8, -1, 1);
  round_to_storage(model);
  return model;
}

std::vector<std::byte> bytes_of(const Model& model) {
  std::vector<std::byte> bytes;
  for (const ModelTensor& tensor : model.tensors()) {
    bytes.insert(bytes.end(), tensor.values.begin(), tensor.values.end());
  }
  return bytes;
}

std::vector<double> texels_of(const Model& model) {
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

TEST(KctaModel, ReadsBackTheBitsThatWereRounded) {
  for (const Shape& s : shapes) {
    for (const Storage storage : {Storage::f16, Storage::f32}) {
      const KctaModel model = random_model(s, 2, storage);
      const TemporaryFolder folder;
      const std::size_t size = write_model(folder / "m.weft", model);
      EXPECT_EQ(size, model_file_size(model));
      const auto found = KctaModel::read(ModelFile(folder / "m.weft"));
      EXPECT_EQ(found->mode, model.mode);
      EXPECT_EQ(found->clusters, model.clusters);
      EXPECT_EQ(found->mixtures, model.mixtures);
      EXPECT_EQ(found->ranks, model.ranks);
      EXPECT_EQ(bytes_of(*found), bytes_of(model));
    }
  }
}

// Eq. (8): every entry of every core times one entry of every factor, whether the cluster is one of
// the slice's or its row of the mixing matrix 0.
TEST(KctaModel, DecodesByTheFormula) {
  for (const Shape& s : shapes) {
    for (const std::size_t mixtures : Sizes{1, 3}) {
      SCOPED_TRACE(std::string(s.merge) + " " + std::to_string(s.mode));
      const KctaModel model = random_model(s, mixtures);
      std::vector<double> sums(shape.values(), 0.0);
      for (std::size_t c = 0; c < model.clusters; ++c) {
        const std::vector<double> part = texels_of(*model.cluster(c));
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += part[i];
      }
      const double tolerance = 1e-12 * static_cast<double>(model.cores.size());
      EXPECT_TRUE(all_near(texels_of(model), sums, tolerance));
      std::vector<double> images(shape.values());
      for (std::size_t first = 0; first < shape.images(); first += 4) {
        const std::size_t count = std::min<std::size_t>(4, shape.images() - first);
        reference::decode_kcta(
            model, first, count,
            std::span(images).subspan(first * shape.image_values(), count * shape.image_values()));
      }
      EXPECT_TRUE(all_near(images, sums, tolerance));
    }
  }
}

TEST(KctaModel, GridsOfViewsAreKept) {
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    const TemporaryFolder folder;
    const KctaModel model = with_grid(random_model(shapes[0], 2, storage));
    write_model(folder / "m.weft", model);
    const auto found = KctaModel::read(ModelFile(folder / "m.weft"));
    EXPECT_EQ(found->view_grid(), 3U);
    EXPECT_EQ(bytes_of(*found), bytes_of(model));
  }
}

// A view of a grid decodes as a measured one with its clusters and coefficients would.
TEST(KctaModel, ViewsOfGridsDecodeByTheFormula) {
  const KctaModel model = with_grid(random_model(shapes[0], 2));
  KctaModel measured = model;
  for (std::size_t e = 0; e < 9; ++e) {
    std::vector<std::uint32_t> members;
    for (std::size_t i = 0; i < model.members.size(); ++i) {
      members.push_back(static_cast<std::uint32_t>(model.members[i]));
    }
    for (std::size_t k = 0; k < 2; ++k) {
      members[k] = static_cast<std::uint32_t>(model.member(shape.views + e, k));
      const auto row = model.mixing_row(shape.views + e, k);
      std::copy(row.begin(), row.end(), measured.mixing.begin() + static_cast<long>(2 * k));
    }
    measured.members = IndexTensor(members, clusters);
    std::vector<double> found(3), expected(3);
    for (std::size_t l = 0; l < shape.lights; ++l) {
      model.decode_texel(shape.views + e, l, 2, 5, found);
      measured.decode_texel(0, l, 2, 5, expected);
      EXPECT_EQ(found, expected);
    }
  }
}

TEST(KctaModel, SelectionsOfAllViewsKeepTheGrid) {
  const KctaModel model = with_grid(random_model(shapes[0], 2));
  Selection lights;
  lights.lights = {{2, 0}};
  lights.region = Region{1, 1, 4, 2};
  const auto part = model.select(lights);
  ASSERT_EQ(part->view_grid(), 3U);
  std::vector<double> found(3), expected(3);
  for (std::size_t v = 0; v < shape.views + 9; ++v) {
    part->decode_texel(v, 1, 1, 2, found);
    model.decode_texel(v, 0, 2, 3, expected);
    EXPECT_EQ(found, expected) << v;
  }
  Selection same;
  same.views = {{0, 1, 2, 3, 4}};
  EXPECT_EQ(model.select(same)->view_grid(), 3U);
  Selection views;
  views.views = {{1, 2, 3, 4}};
  EXPECT_EQ(model.select(views)->view_grid(), 0U);
  views.views = {{0, 1, 2}};
  EXPECT_EQ(model.select(views)->view_grid(), 0U);
}

// Divided by factors of views, a grid is by what lies between them: where a view of the grid is a
// measured one, by its own.
TEST(KctaModel, GridsAreDividedAsTheirViews) {
  KctaModel model = with_grid(random_model(shapes[0], 2, Storage::f32));
  const ViewGrid grid(3);
  for (std::size_t v = 0; v < shape.views; ++v) {
    const auto d = grid.direction(2 * v);
    model.info.btf.view_directions[v] = {static_cast<float>(d[0]), static_cast<float>(d[1]),
                                         static_cast<float>(d[2])};
  }
  KctaModel divided = model;
  Weights scale;
  scale.views = {1, 2, 4, 8, 16};
  divided.divide(scale);
  for (std::size_t e = 0; e < 9; ++e) {
    const double found =
        double{model.mixing_row(5 + e, 1)[0]} / double{divided.mixing_row(5 + e, 1)[0]};
    EXPECT_GE(found, 1 - 1e-6);
    EXPECT_LE(found, 16 + 1e-6);
    if (e % 2 == 0) {
      EXPECT_NEAR(found, scale.views[e / 2], 1e-4);
    }
  }
}

TEST(KctaModel, GridsThatDoNotFitAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const auto expect_refused = [&](const KctaModel& model,
                                  std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { KctaModel::read(ModelFile(path)); });
  };
  const KctaModel model = with_grid(random_model(shapes[0], 2));
  const std::size_t last = model.tensors().size() - 1;  // grid.mixing, behind grid.clusters
  expect_refused(model, {"m.weft", "grid.mixing"},
                 [&](LyingModel& m) { m.list.erase(m.list.begin() + static_cast<long>(last)); });
  expect_refused(model, {"m.weft", "grid.clusters", "N N"}, [&](LyingModel& m) {
    m.list[last - 1].shape = {6, 3};
  });
  expect_refused(model, {"m.weft", "grid.clusters"}, [&](LyingModel& m) {
    m.list[last - 1].shape = {9, 1, 2};
  });
  const std::vector<std::uint8_t> twice(18, 1);
  expect_refused(model, {"m.weft", "grid.clusters", "ascend"},
                 [&](LyingModel& m) { m.list[last - 1].values = std::as_bytes(std::span(twice)); });
  KctaModel of_lights = random_model(shapes[2], 2);
  of_lights.grid_side = 1;
  of_lights.grid_members = IndexTensor(std::vector<std::uint32_t>{0, 1}, clusters);
  of_lights.grid_mixing.assign(2 * of_lights.ranks[of_lights.mode], 1.0f);
  expect_refused(of_lights, {"m.weft", "grid.clusters", "mode lc"}, [](LyingModel&) {});
}

TEST(KctaModel, OneMixingRowMeetsOneCore) {
  // by hand: one light, one texel, one channel; T[v] = sum_k u_vk . Z_ck
  KctaModel model;
  model.info.codec = "kcta";
  model.info.btf = make_info({3, 1, 1, 1, 1}, DType::f32);
  model.set_groups(ModeGroups(model.info.btf.shape, "lc"), 0);
  model.clusters = 3;
  model.mixtures = 2;
  model.ranks = {2, 1, 1, 1};
  model.members = IndexTensor(std::vector<std::uint32_t>{0, 1, 0, 2, 1, 2}, 3);
  model.cores = {1, 2, 10, 20, 100, 200};
  model.mixing = {1, 0, 0, 1, 2, 1, 1, 1, 0, 3, 1, 0};
  EXPECT_EQ(texels_of(model), (std::vector<double>{1 + 20, 4 + 300, 60 + 100}));
}

TEST(KctaModel, SelectionsAreParts) {
  Selection selection;
  selection.views = {{4, 1}};
  selection.lights = {{2, 0}};
  selection.region = Region{1, 1, 4, 2};
  selection.channels = {{1, 2}};
  for (const Shape& s : shapes) {
    SCOPED_TRACE(std::string(s.merge) + " " + std::to_string(s.mode));
    const KctaModel model = random_model(s, 2);
    const std::vector<double> whole = texels_of(model);
    const auto part = model.select(selection);
    EXPECT_LE(part->clusters, model.clusters);
    std::vector<double> expected;
    for (const std::size_t v : *selection.views) {
      for (const std::size_t l : *selection.lights) {
        for (std::size_t y = 1; y < 3; ++y) {
          for (std::size_t x = 1; x < 5; ++x) {
            for (const std::size_t c : *selection.channels) {
              expected.push_back(whole[(((v * 3 + l) * 4 + y) * 6 + x) * 3 + c]);
            }
          }
        }
      }
    }
    EXPECT_EQ(texels_of(*part), expected);
    // clusters that no slice has are gone, and the part has a file of its own
    const TemporaryFolder folder;
    write_model(folder / "part.weft", *part);
    EXPECT_EQ(texels_of(*KctaModel::read(ModelFile(folder / "part.weft"))), expected);
    std::vector<bool> used(part->clusters, false);
    for (std::size_t i = 0; i < part->members.size(); ++i) used[part->members[i]] = true;
    EXPECT_EQ(std::count(used.begin(), used.end(), false), 0);
  }
}

TEST(KctaModel, ExpandedModesDecodeAlike) {
  for (const Shape& s : shapes) {
    SCOPED_TRACE(std::string(s.merge) + " " + std::to_string(s.mode));
    const KctaModel model = random_model(s, 2);
    const std::vector<double> values = texels_of(model);
    for (std::size_t n = 0; n < model.groups.count(); ++n) {
      const std::string& name = model.groups.groups()[n].name;
      if (n == model.mode) {
        expect_error(ErrorKind::input, {"--expand " + name, "clusters"},
                     [&] { expanded(model, name); });
        continue;
      }
      const auto larger = expanded(model, name);
      EXPECT_FALSE(larger->has_factor(n));
      // the cores are rounded to float again
      EXPECT_TRUE(
          all_near(texels_of(*larger), values, 1e-6 * static_cast<double>(model.cores.size())));
    }
  }
  const KctaModel model = random_model(shapes[0], 2);
  const auto rendered = expanded(model, "y,x");
  EXPECT_EQ(rendered->ranks, (Sizes{2, 4, 4, 6}));
  expect_error(ErrorKind::input, {"--expand q", "v, lc, y, x"}, [&] { expanded(model, "q"); });
}

TEST(KctaModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const KctaModel model = random_model(shapes[0], 2);
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { KctaModel::read(ModelFile(path)); });
  };
  // tensors: modes, clustered, clusters, mixing, cores, global.lc, factor.y, factor.x
  expect_refused({"m.weft", "codec", "vq"}, [](LyingModel& m) { m.info.codec = "vq"; });
  expect_refused({"m.weft", "clusters", "cta"}, [](LyingModel& m) { m.info.codec = "cta"; });
  expect_refused({"m.weft", "cores", "[8, 48]"}, [](LyingModel& m) { m.list[4].shape = {8, 48}; });
  expect_refused({"m.weft", "factor.y"}, [](LyingModel& m) { m.list[4].shape = {4, 2, 4, 4, 3}; });
  expect_refused({"m.weft", "global.lc"}, [](LyingModel& m) { m.list[4].shape = {4, 1, 8, 3, 4}; });
  expect_refused({"m.weft", "clusters", "[10]"}, [](LyingModel& m) { m.list[2].shape = {10}; });
  expect_refused({"m.weft", "clusters", "K from 1 to 4"}, [](LyingModel& m) {
    m.list[2].shape = {2, 5};
  });
  for (const std::string_view name : {"modes", "clustered", "clusters", "mixing", "cores"}) {
    expect_refused({"m.weft", name}, [&](LyingModel& m) {
      std::erase_if(m.list, [&](const ModelTensor& tensor) { return tensor.name == name; });
    });
  }
  expect_refused({"m.weft", "mode y"}, [](LyingModel& m) { m.list.erase(m.list.begin() + 6); });
  expect_refused({"m.weft", "global.y", "factor.y"}, [](LyingModel& m) {
    m.list.push_back(m.list[6]);
    m.list.back().name = "global.y";
  });
  const std::uint8_t modes = 4;
  expect_refused({"m.weft", "clustered", "4"},
                 [&](LyingModel& m) { m.list[1].values = std::as_bytes(std::span(&modes, 1)); });
  const std::vector<std::uint8_t> twice{0, 1, 0, 2, 1, 1, 2, 3, 0, 3};
  expect_refused({"m.weft", "clusters", "slice 2"},
                 [&](LyingModel& m) { m.list[2].values = std::as_bytes(std::span(twice)); });
  const std::vector<std::uint8_t> beyond{0, 1, 0, 2, 1, 4, 2, 3, 0, 3};
  expect_refused({"m.weft", "clusters", "4"},
                 [&](LyingModel& m) { m.list[2].values = std::as_bytes(std::span(beyond)); });
}

}  // namespace
}  // namespace weft::test
