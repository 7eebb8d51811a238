// Data bases of materials that share code-books: files and back, materials by name, mip levels,
// parts of code-books that keep their own rounding, and files that lie.
#include "weft/model/vq_base.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "model/damage_model.hpp"
#include "model/edit_model.hpp"
#include "model/random_vq.hpp"
#include "support/expect_error.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/mip.hpp"
#include "weft/error.hpp"
#include "weft/model/material_file.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

const BtfShape shape{5, 6, 3, 4, 3};

VqCodeBook random_index(Random& random, std::size_t texels, std::size_t entries) {
  return {random_indices(random, texels, entries), random_list(random, texels)};
}

// Of two mip levels and masks, on two sizes of textures, the second material added later.
VqBase two_materials(Storage storage) {
  Random random(8);
  VqBase base;
  VqModel first = random_vq(shape, VqGrid::measured(shape), small_sizes, 3);
  base.books = first;
  base.books.info = {};
  base.books.info.codec = "vq";
  base.books.info.storage = storage;
  base.books.p6 = {};
  base.books.earlier = {{4, 3, 5, 3, 1, 6, 3, 2}};
  // what was added is a thousand times what was there: one scale for both would lose bits of these
  for (std::size_t i = 6 * 2; i < base.books.c.size(); ++i) base.books.c[i] *= 1000;
  for (float& value : base.books.c) value += 0.001f;
  base.books.seal();
  round_to_storage(base.books);
  for (const char* const name : {"wool", "cord"}) {
    VqMaterial material{name, {}};
    VqModel& index = material.index;
    index.info = first.info;
    index.info.storage = storage;
    BtfShape& own = index.info.btf.shape;
    own.height = name[0] == 'w' ? 7 : 2;
    own.width = 5;
    index.info.btf.mask.assign(own.views * own.texels(), 1);
    index.info.btf.mask[3] = 0;
    index.p6 = random_index(random, own.texels(), small_sizes.p4);
    if (name[0] == 'w') {
      index.coarser = {random_index(random, 4 * 3, small_sizes.p4),
                       random_index(random, 2 * 2, small_sizes.p4)};
    }
    round_to_storage(index);
    base.materials.push_back(std::move(material));
  }
  return base;
}

std::vector<double> values_of(const Model& model) {
  const BtfShape& of = model.info.btf.shape;
  std::vector<double> values;
  std::vector<double> texel(of.channels);
  for (std::size_t v = 0; v < of.views; ++v) {
    for (std::size_t l = 0; l < of.lights; ++l) {
      for (std::size_t p = 0; p < of.texels(); ++p) {
        model.fitted_texel(v, l, p / of.width, p % of.width, texel);
        values.insert(values.end(), texel.begin(), texel.end());
      }
    }
  }
  return values;
}

class VqBaseFile : public testing::Test {
 protected:
  std::string path(const std::string& name = "base.weft") const { return folder_ / name; }
  TemporaryFolder folder_;
};

TEST_F(VqBaseFile, EachMaterialIsAModel) {
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    const VqBase base = two_materials(storage);
    EXPECT_EQ(write_vq_base(path(), base), vq_base_size(base));
    const VqBase found = VqBase::read(path());
    ASSERT_EQ(found.materials.size(), 2U);
    EXPECT_EQ(found.books.earlier, base.books.earlier);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto wanted = base.model(i);
      const auto read = VqModel::read(ModelFile(path() + ":" + base.materials[i].name));
      EXPECT_EQ(values_of(*read), values_of(*wanted));
      EXPECT_EQ(values_of(*found.model(i)), values_of(*wanted));
      EXPECT_EQ(read->info.btf.mask, wanted->info.btf.mask);
      EXPECT_EQ(read->coarser.size(), wanted->coarser.size());
    }
    const VqBaseBytes bytes = vq_base_bytes(base);
    EXPECT_GT(bytes.own[0], bytes.own[1]);
    EXPECT_GT(vq_base_size(base), bytes.shared + bytes.own[0] + bytes.own[1]);
  }
}

// Alone it decodes to the same bits, without code-vectors of the other, and so does its file.
TEST_F(VqBaseFile, AMaterialCanBeTakenOut) {
  for (const bool quantised : {false, true}) {
    VqBase base = two_materials(quantised ? Storage::f32 : Storage::f16);
    if (quantised) {
      quantise_others(base.books, 8);
      for (VqMaterial& material : base.materials) quantise_others(material.index, 8);
    }
    for (std::size_t i = 0; i < 2; ++i) {
      // one entry alone: most code-vectors go
      VqCodeBook& p6 = base.materials[i].index.p6;
      p6.entries = PackedIndices(std::vector<std::uint32_t>(p6.scales.size(), 2), small_sizes.p4);
      // but of a mip level
      VqModel& index = base.materials[i].index;
      if (!index.coarser.empty()) {
        index.coarser.resize(1);
        index.coarser[0].entries = PackedIndices(std::vector<std::uint32_t>(12, 1), small_sizes.p4);
      }
      const auto whole = base.model(i);
      const auto alone = whole->select({});
      EXPECT_EQ(alone->sizes.p4, i == 0 ? 2U : 1U);
      if (i == 0) {
        EXPECT_EQ(values_of(*alone->next_mip_level()), values_of(*whole->next_mip_level()));
      }
      EXPECT_EQ(values_of(*alone), values_of(*whole));
      write_model(path("alone.weft"), *alone);
      EXPECT_EQ(values_of(*VqModel::read(ModelFile(path("alone.weft")))), values_of(*whole));
    }
  }
}

TEST_F(VqBaseFile, MipLevelsAreModelsToo) {
  const VqBase base = two_materials(Storage::f32);
  const auto model = base.model(0);
  const auto level = model->next_mip_level();
  ASSERT_NE(level, nullptr);
  EXPECT_EQ(level->info.btf.shape, (BtfShape{5, 6, 4, 3, 3}));
  EXPECT_EQ(level->info.btf.mask.size(), 5U * 12U);
  std::vector<double> texel(3), entry(3);
  level->fitted_texel(2, 3, 3, 1, texel);
  const VqCodeBook& index = model->coarser[0];
  model->entry_values(index.entries[10], vq_place(model->grid, model->info.btf, 2, 3), entry);
  EXPECT_EQ(texel[0], entry[0] * double{index.scales[10]});
  EXPECT_EQ(texel[1], entry[1]);
  EXPECT_EQ(level->next_mip_level()->next_mip_level(), nullptr);
  // a region keeps the levels whose texels it does not cut
  Selection even;
  even.region = Region{2, 4, 3, 3};
  const auto part = model->select(even);
  ASSERT_EQ(part->coarser.size(), 1U);
  ASSERT_EQ(part->coarser[0].scales.size(), 4U);
  EXPECT_EQ(part->coarser[0].scales[0], model->coarser[0].scales[2 * 3 + 1]);
  EXPECT_EQ(part->coarser[0].scales[3], model->coarser[0].scales[3 * 3 + 2]);
  // with the entries that its texels have in the whole
  const auto coarse = part->next_mip_level();
  std::vector<double> of_part(3);
  for (std::size_t p = 0; p < 4; ++p) {
    coarse->fitted_texel(1, 2, p / 2, p % 2, of_part);
    level->fitted_texel(1, 2, 2 + p / 2, 1 + p % 2, texel);
    EXPECT_EQ(of_part, texel);
  }
  Selection odd;
  odd.region = Region{1, 4, 4, 3};
  EXPECT_TRUE(model->select(odd)->coarser.empty());
}

TEST_F(VqBaseFile, MaterialsAreNamed) {
  write_vq_base(path(), two_materials(Storage::f16));
  const auto open = [&](const std::string& name) { return [=] { ModelFile file(name); }; };
  expect_error(ErrorKind::input, {"base.weft", "2 materials", "wool, cord", "base.weft:wool"},
               open(path()));
  expect_error(ErrorKind::input, {"base.weft", "without a material 'silk'", "wool, cord"},
               open(path() + ":silk"));
  write_model(path("one.weft"), random_vq(shape, VqGrid::measured(shape), small_sizes, 3));
  expect_error(ErrorKind::input, {"one.weft", "no data base", "'wool'"},
               open(path("one.weft") + ":wool"));
  // a model is a data base of one
  const VqBase one = VqBase::read(path("one.weft"));
  ASSERT_EQ(one.materials.size(), 1U);
  EXPECT_EQ(one.materials[0].name, "one");
  EXPECT_EQ(values_of(*one.model(0)), values_of(*VqModel::read(ModelFile(path("one.weft")))));
  for (const char* const name : {"", "a/b", "a:b", "a b", "\xc3\xa4"}) {
    EXPECT_THROW(check_material_name(name, "--names"), Error) << name;
  }
  EXPECT_THROW(check_material_name(std::string(65, 'a'), "--names"), Error);
  check_material_name("Wool_2.5-a+b", "--names");
  EXPECT_EQ(material_path("a.weft:b.c").name, "b.c");
  EXPECT_EQ(material_path("a.weft").name, "");
  EXPECT_EQ(material_path("a:b.weft").name, "");
}

TEST_F(VqBaseFile, FilesThatLieAreRefused) {
  using nlohmann::json;
  write_vq_base(path(), two_materials(Storage::f32));
  const EditableModel good(read_bytes(path()));
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const std::function<void(EditableModel&)>& change) {
    EditableModel edited = good;
    change(edited);
    edited.set_checksums();
    write_bytes(path("lie.weft"), edited.file());
    expect_error(ErrorKind::input, parts, [&] { VqBase::read(path("lie.weft")); });
    expect_error(ErrorKind::input, parts,
                 [&] { VqModel::read(ModelFile(path("lie.weft") + ":wool")); });
  };
  const auto with_materials = [](const std::function<void(json&)>& change) {
    return [change](EditableModel& edited) {
      json list = json::parse(edited.metadata()["materials"].get<std::string>());
      change(list);
      edited.metadata()["materials"] = list.dump();
    };
  };
  expect_refused({"lie.weft", "materials", "two materials named 'wool'"},
                 with_materials([](json& list) { list[1]["name"] = "wool"; }));
  expect_refused({"lie.weft", "materials", "'a/b'"},
                 with_materials([](json& list) { list[1]["name"] = "a/b"; }));
  expect_refused({"lie.weft", "materials", "\"shape\" is no text"},
                 with_materials([](json& list) { list[0]["shape"] = 3; }));
  expect_refused({"lie.weft", "materials"},
                 with_materials([](json& list) { list = json::object(); }));
  expect_refused({"lie.weft", "tensor \"cord/", "of no material"},
                 with_materials([](json& list) { list.erase(1); }));
  expect_refused({"lie.weft:wool", "mask", "shape"},
                 with_materials([](json& list) { list[0]["shape"] = "[5,6,7,6,3]"; }));
  expect_refused({"lie.weft:wool", "no metadata \"dtype\""},
                 with_materials([](json& list) { list[0].erase("dtype"); }));
  expect_refused({"lie.weft:wool", "no tensor \"P6\""},
                 [](EditableModel& edited) { edited.rename("wool/P6", "wool/P6x"); });
  expect_refused({"lie.weft", "tensor \"P6\" is of no material"},
                 [](EditableModel& edited) { edited.rename("wool/P6", "P6"); });
  expect_refused({"lie.weft", "tensor \"wool/P2\"", "to be shared"},
                 [](EditableModel& edited) { edited.rename("P2", "wool/P2"); });
  expect_refused({"lie.weft:wool", "P6.level2", "behind 1 levels of 5 x 7"},
                 [](EditableModel& edited) { edited.rename("wool/P6.level2", "wool/P6.level3"); });
  // one index of three that two bits hold a fourth of
  expect_refused({"lie.weft:wool", "P6", "is not below 3"}, [](EditableModel& edited) {
    edited.data.replace(edited.begin("wool/P6"), 1, "\xff");
  });
  expect_refused({"lie.weft:wool", "layout", "before and"}, [](EditableModel& edited) {
    edited.data.replace(edited.begin("layout") + 14 * 4, 1, "\x20");
  });
  expect_refused({"lie.weft:wool", "layout", "words"}, [](EditableModel& edited) {
    edited.header["layout"]["dtype"] = "U16";
    edited.header["layout"]["shape"] = {44};
  });
}

// Bytes changed under right checksums: an error that says so, or models that can be decoded.
TEST_F(VqBaseFile, DamagedFilesGiveErrorsOnly) {
  Random random(22);
  write_vq_base(path(), two_materials(Storage::f16));
  const std::size_t decoded = damage_and_open(path(), 300, random, [&] {
    const VqBase found = VqBase::read(path());
    for (std::size_t m = 0; m < 2; ++m) values_of(*found.model(m));
  });
  EXPECT_GT(decoded, 0U);
}

}  // namespace
}  // namespace weft::test
