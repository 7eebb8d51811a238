// Sparse models: decoded by hand, selected, and files whose tensors do not fit each other.
#include "weft/model/sparse.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "io/file_bytes.hpp"
#include "model/damage_model.hpp"
#include "model/edit_model.hpp"
#include "model/lying_model.hpp"
#include "model/random_sparse.hpp"
#include "support/expect_error.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

using Indices = std::vector<std::uint32_t>;

// Two views, one light, three texels; D1 = 3, D2 = 2, k1 = 2, k2 = 1.
SparseModel small_model(Storage storage) {
  SparseModel model;
  model.info.codec = "sparse";
  model.info.storage = storage;
  model.info.btf = make_info({2, 1, 1, 3, 1}, DType::f16);
  model.light_atoms = 3;
  model.abrdf_atoms = 2;
  model.mean = {10, 20};
  model.dictionary = {1, 2, 4};
  model.views = {2, IndexTensor(Indices{0, 1, 0, 2, 1, 2, 0, 1}, 3), {1, 2, 3, 4, 5, 6, 7, 0}};
  model.texels = {1, IndexTensor(Indices{0, 1, 0}, 2), {1, -1, 2}};
  return model;
}

TEST(SparseModel, DecodesByTheFormula) {
  const SparseModel model = small_model(Storage::f32);
  const auto value = [&](std::size_t view, std::size_t x) {
    std::vector<double> out(1);
    model.decode_texel(view, 0, 0, x, out);
    return out[0];
  };
  EXPECT_EQ(value(0, 0), 10 + 1 * (1 * 1 + 2 * 2));
  EXPECT_EQ(value(1, 0), 20 + 1 * (3 * 1 + 4 * 4));
  EXPECT_EQ(value(0, 1), 10 - 1 * (5 * 2 + 6 * 4));
  EXPECT_EQ(value(1, 1), 20 - 1 * (7 * 1 + 0 * 2));
  EXPECT_EQ(value(0, 2), 10 + 2 * (1 * 1 + 2 * 2));
}

TEST(SparseModel, SelectionsDropUnusedAtoms) {
  const SparseModel model = small_model(Storage::f32);
  Selection selection;
  selection.region = Region{1, 0, 1, 1};
  selection.views = {{0}};
  const auto part = model.select(selection);
  EXPECT_EQ(part->abrdf_atoms, 1U);
  EXPECT_EQ(part->light_atoms, 2U);
  EXPECT_EQ(part->dictionary, (std::vector<float>{2, 4}));
  EXPECT_EQ(part->mean, (std::vector<float>{10}));
  std::vector<double> out(1);
  part->decode_texel(0, 0, 0, 0, out);
  EXPECT_EQ(out[0], 10 - 1 * (5 * 2 + 6 * 4));
}

TEST(SparseModel, SelectionsDecodeToTheSame) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const SparseModel model = random_sparse(shape, {20, 15, 4, 3});
  Selection selection;
  selection.views = {{2, 0}};
  selection.lights = {{3, 1}};
  selection.region = Region{1, 2, 3, 2};
  selection.channels = {{2, 0}};
  const auto part = model.select(selection);
  std::vector<double> whole(3);
  std::vector<double> found(2);
  for (std::size_t v = 0; v < 2; ++v) {
    for (std::size_t l = 0; l < 2; ++l) {
      for (std::size_t y = 0; y < 2; ++y) {
        for (std::size_t x = 0; x < 3; ++x) {
          model.decode_texel((*selection.views)[v], (*selection.lights)[l], y + 2, x + 1, whole);
          part->decode_texel(v, l, y, x, found);
          EXPECT_TRUE(all_equal(found, std::vector<double>{whole[2], whole[0]}));
        }
      }
    }
  }
}

TEST(SparseModel, IndicesTakeAByteWhereTheyFit) {
  for (const std::size_t atoms : {256, 257}) {
    const SparseModel model = random_sparse({2, 2, 3, 3, 1}, {atoms, atoms, 3, 2});
    const DType wanted = atoms == 256 ? DType::u8 : DType::u16;
    EXPECT_EQ(model.tensors()[2].dtype, wanted);
    EXPECT_EQ(model.tensors()[4].dtype, wanted);
  }
}

TEST(SparseModel, SurvivesItsFile) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  for (const SparseSizes& sizes : {SparseSizes{300, 270, 5, 4}, SparseSizes{0, 0, 0, 0}}) {
    for (const Storage storage : {Storage::f16, Storage::f32}) {
      SparseModel model = random_sparse({3, 4, 5, 6, 3}, sizes);
      model.info.storage = storage;
      round_to_storage(model);
      write_model(path, model);
      const auto found = SparseModel::read(ModelFile(path));
      EXPECT_EQ(found->light_atoms, sizes.light_atoms);
      EXPECT_EQ(found->abrdf_atoms, sizes.abrdf_atoms);
      for (std::size_t i = 0; i < model.tensors().size(); ++i) {
        const auto a = found->tensors()[i].values;
        const auto b = model.tensors()[i].values;
        EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << i;
      }
    }
  }
}

TEST(SparseModel, TensorsThatDoNotFitEachOtherAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const SparseModel model = small_model(Storage::f16);
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const auto& change) {
    LyingModel lying(model);
    change(lying);
    write_model(path, lying);
    expect_error(ErrorKind::input, parts, [&] { SparseModel::read(ModelFile(path)); });
  };
  const std::vector<std::uint8_t> beyond{0, 1, 0, 3, 1, 2, 0, 1};
  const std::vector<std::uint8_t> descending{0, 1, 2, 0, 1, 2, 0, 1};
  const std::vector<std::uint8_t> twice{0, 1, 0, 2, 1, 1, 0, 1};
  const std::vector<std::uint8_t> texel_beyond{0, 2, 0};
  expect_refused({"m.weft", "view_atoms", "3 at index 3"},
                 [&](LyingModel& m) { m.list[2].values = std::as_bytes(std::span(beyond)); });
  expect_refused({"m.weft", "view_atoms", "0 behind 2 at index 3"},
                 [&](LyingModel& m) { m.list[2].values = std::as_bytes(std::span(descending)); });
  expect_refused({"m.weft", "view_atoms", "1 behind 1 at index 5"},
                 [&](LyingModel& m) { m.list[2].values = std::as_bytes(std::span(twice)); });
  expect_refused({"m.weft", "texel_atoms", "2 at index 1"},
                 [&](LyingModel& m) { m.list[4].values = std::as_bytes(std::span(texel_beyond)); });
  expect_refused({"m.weft", "view_atoms", "[2, 4]"}, [](LyingModel& m) {
    m.list[2].shape = {2, 4};
  });
  expect_refused({"m.weft", "view_atoms", "lists of 4 among 3"}, [](LyingModel& m) {
    m.list[2].shape = {1, 2, 4};
  });
  expect_refused({"m.weft", "view_coefficients", "[4, 2, 1]", "[2, 2, 2]"}, [](LyingModel& m) {
    m.list[3].shape = {4, 2, 1};
  });
  expect_refused({"m.weft", "texel_atoms", "[3]"}, [](LyingModel& m) { m.list[4].shape = {3}; });
  expect_refused({"m.weft", "texel_atoms", "lists of 3 among 2"}, [](LyingModel& m) {
    m.list[4].shape = {1, 3};
  });
  expect_refused({"m.weft", "dictionary", "[3]"}, [](LyingModel& m) { m.list[1].shape = {3}; });
  expect_refused({"m.weft", "dictionary", "[1, 3, 1]"}, [](LyingModel& m) {
    m.list[1].shape = {1, 3, 1};
  });
  expect_refused({"m.weft", "no tensor \"texel_atoms\""},
                 [](LyingModel& m) { m.list.erase(m.list.begin() + 4); });
  expect_refused({"m.weft", "codec", "pca"}, [](LyingModel& m) { m.info.codec = "pca"; });
}

TEST(SparseModel, CoefficientsThatAreNoNumbersAreRefused) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const SparseModel model = small_model(Storage::f32);
  write_model(path, model);
  for (const char* tensor : {"dictionary", "view_coefficients", "texel_coefficients"}) {
    EditableModel edited(read_bytes(path));
    const float nan = std::numeric_limits<float>::quiet_NaN();
    std::memcpy(edited.data.data() + edited.begin(tensor) + sizeof(nan), &nan, sizeof(nan));
    edited.set_checksums();
    write_bytes(path, edited.file());
    expect_error(ErrorKind::input, {"m.weft", tensor, "index 1 is not finite"},
                 [&] { SparseModel::read(ModelFile(path)); });
    write_model(path, model);
  }
}

// Bytes changed under right checksums: an error that says so, or a model that can be decoded.
TEST(SparseModel, DamagedFilesGiveErrorsOnly) {
  const TemporaryFolder folder;
  const auto path = folder / "m.weft";
  Random random(21);
  std::size_t decoded = 0;
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    SparseModel model = small_model(storage);
    round_to_storage(model);
    write_model(path, model);
    decoded += damage_and_open(path, 500, random, [&] {
      const auto found = SparseModel::read(ModelFile(path));
      std::vector<double> texel(1);
      for (std::size_t x = 0; x < 3; ++x) found->decode_texel(1, 0, 0, x, texel);
    });
  }
  EXPECT_GT(decoded, 0U);
}

}  // namespace
}  // namespace weft::test
