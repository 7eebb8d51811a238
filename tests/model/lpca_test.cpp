// Local PCA models: decoded by hand, selected, and files whose tensors do not fit each other.
#include "weft/model/lpca.hpp"

#include <gtest/gtest.h>

#include "io/file_bytes.hpp"
#include "model/damage_model.hpp"
#include "model/lying_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

// Three texels; texel 1 alone in cluster 1 of rank 1, the others in cluster 0 of rank 2.
LpcaModel small_model(Storage storage) {
  LpcaModel model;
  model.info.codec = "lpca";
  model.info.storage = storage;
  model.info.btf = make_info({2, 1, 1, 3, 1}, DType::f16);
  model.rank = 2;
  model.clusters = IndexTensor(std::vector<std::uint32_t>{0, 1, 0}, 2);
  model.ranks = IndexTensor(std::vector<std::uint32_t>{2, 1}, 3);
  model.mean = {10, 20, 30, 40};            // [G, V, L, C]
  model.coefficients = {1, 2, 3, 0, 5, 6};  // [P, k]
  model.basis = {1, -1, 2, -2, 7, 8};       // [K, V, L, C]
  return model;
}

TEST(LpcaModel, DecodesByTheFormula) {
  const LpcaModel model = small_model(Storage::f32);
  std::vector<double> out(1);
  model.decode_texel(0, 0, 0, 0, out);
  EXPECT_EQ(out[0], 10 + 1 * 1 + 2 * 2);
  model.decode_texel(1, 0, 0, 2, out);
  EXPECT_EQ(out[0], 20 - 5 * 1 - 6 * 2);
  model.decode_texel(1, 0, 0, 1, out);
  EXPECT_EQ(out[0], 40 + 3 * 8);
}

TEST(LpcaModel, SelectionsDropUnusedClusters) {
  const LpcaModel model = small_model(Storage::f32);
  Selection selection;
  selection.region = Region{1, 0, 1, 1};
  selection.views = {{1}};
  const auto part = model.select(selection);
  EXPECT_EQ(part->ranks.size(), 1U);
  EXPECT_EQ(part->mean, (std::vector<float>{40}));
  EXPECT_EQ(part->basis, (std::vector<float>{8}));
  std::vector<double> out(1);
  part->decode_texel(0, 0, 0, 0, out);
  EXPECT_EQ(out[0], 40 + 3 * 8);
}

TEST(LpcaModel, IndicesTakeAByteWhereTheyFit) {
  LpcaModel model = small_model(Storage::f32);
  EXPECT_EQ(model.tensors()[0].dtype, DType::u8);
  EXPECT_EQ(model.tensors()[0].values.size(), 3U);
}

TEST(LpcaModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const LpcaModel model = small_model(Storage::f16);
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { LpcaModel::read(ModelFile(path)); });
  };
  const std::vector<std::uint8_t> out_of_range{0, 2, 0};
  const std::vector<std::uint8_t> too_many{2, 3};
  const std::vector<std::uint8_t> too_few{1, 1};
  expect_refused({"m.weft", "clusters", "2 at index 1"},
                 [&](LyingModel& m) { m.list[0].values = std::as_bytes(std::span(out_of_range)); });
  expect_refused({"m.weft", "ranks", "3 at index 1"},
                 [&](LyingModel& m) { m.list[1].values = std::as_bytes(std::span(too_many)); });
  expect_refused({"m.weft", "basis", "[3, 2, 1, 1]", "[2, 2, 1, 1]"},
                 [&](LyingModel& m) { m.list[1].values = std::as_bytes(std::span(too_few)); });
  expect_refused({"m.weft", "clusters", "[3, 1]"}, [](LyingModel& m) { m.list[0].shape = {3, 1}; });
  expect_refused({"m.weft", "ranks", "[2, 1]"}, [](LyingModel& m) { m.list[1].shape = {2, 1}; });
  expect_refused({"m.weft", "ranks", "[0]"}, [](LyingModel& m) {
    m.list[1].shape = {0};
    m.list[1].values = {};
  });
  expect_refused({"m.weft", "mean", "[4]"}, [](LyingModel& m) {
    m.list[2].shape = {4};
    m.list[2].component_axis = ModelTensor::no_component_axis;
  });
  expect_refused({"m.weft", "coefficients", "[2, 3]", "[3, 3]"}, [](LyingModel& m) {
    m.list[3].shape = {2, 3};
  });
  expect_refused({"m.weft", "coefficients", "[6]"}, [](LyingModel& m) {
    m.list[3].shape = {6};
    m.list[3].component_axis = ModelTensor::no_component_axis;
  });
  expect_refused({"m.weft", "no tensor \"clusters\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin()); });
  expect_refused({"m.weft", "codec", "pca"}, [](LyingModel& m) { m.info.codec = "pca"; });
}

// Bytes changed under right checksums: an error that says so, or a model that can be decoded.
TEST(LpcaModel, DamagedFilesGiveErrorsOnly) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  Random random(21);
  std::size_t decoded = 0;
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    LpcaModel model = small_model(storage);
    round_to_storage(model);
    write_model(path, model);
    decoded += damage_and_open(path, 500, random, [&] {
      const auto found = LpcaModel::read(ModelFile(path));
      std::vector<double> texel(1);
      for (std::size_t x = 0; x < 3; ++x) found->decode_texel(1, 0, 0, x, texel);
    });
  }
  EXPECT_GT(decoded, 0U);
}

}  // namespace
}  // namespace weft::test
