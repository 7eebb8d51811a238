// Model files with quantised tensors and entropy-coded blobs: what they give back, their size, and
// every way in which one may be wrong.
#include <gtest/gtest.h>

#include <bit>
#include <filesystem>
#include <functional>
#include <limits>

#include "model/edit_model.hpp"
#include "model/random_sparse.hpp"
#include "model/small_pca.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/largest_allocation.hpp"
#include "support/matchers.hpp"
#include "support/mutate.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/coded_tensor.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/quantise.hpp"
#include "weft/model/storage.hpp"

namespace weft {
namespace {

using test::all_equal;
using test::EditableModel;
using test::expect_error;
using test::read_bytes;
using test::small_pca;
using test::TemporaryFolder;
using test::write_bytes;

// Larger than the others' small one, so that coding pays.
PcaModel quantised_pca(unsigned bits, double magnitude = 1.0) {
  PcaModel model = small_pca(Storage::f32, 3, magnitude, {3, 4, 8, 9, 3});
  quantise_all(model, bits);
  return model;
}

const std::string& valid_file() {
  static const std::string file = [] {
    TemporaryFolder folder;
    write_model(folder / "m", quantised_pca(9));
    return read_bytes(folder / "m");
  }();
  return file;
}

void expect_refused(const std::string& file, std::initializer_list<std::string_view> parts) {
  TemporaryFolder folder;
  const auto path = folder / "m.weft";
  write_bytes(path, file);
  test::reset_largest_allocation();
  expect_error(ErrorKind::input, {"m.weft"}, [&] { PcaModel::read(ModelFile(path)); });
  // room for a first piece of a blob, and the header's JSON
  EXPECT_LE(test::largest_allocation(), 4 * file.size() + (std::size_t{1} << 17));
  expect_error(ErrorKind::input, parts, [&] { PcaModel::read(ModelFile(path)); });
}

void expect_edit_refused(std::initializer_list<std::string_view> parts,
                         const std::function<void(EditableModel&)>& change) {
  EditableModel model(valid_file());
  change(model);
  model.set_checksums();
  expect_refused(model.file(), parts);
}

// One field of what the metadata say of a blob.
void set_field(EditableModel& model, const char* tensor, const char* field,
               const nlohmann::json& value) {
  auto coded = nlohmann::json::parse(model.metadata()["coded"].get<std::string>());
  if (value.is_null()) {
    coded[tensor].erase(field);
  } else {
    coded[tensor][field] = value;
  }
  model.metadata()["coded"] = coded.dump();
}

// Other bytes in place of a tensor's.
void replace(EditableModel& model, const std::string& tensor, const std::string& bytes) {
  model.rename(tensor, "old." + tensor);
  model.append(tensor, "U8", {bytes.size()}, bytes);
}

TEST(CodedModel, GivesBackTheModelOfEveryWidth) {
  TemporaryFolder folder;
  for (unsigned bits = least_bits; bits <= most_bits; ++bits) {
    for (const double magnitude : {1.0, 1e30, 1e-30, 1e-42}) {
      const PcaModel model = quantised_pca(bits, magnitude);
      const std::size_t size = write_model(folder / "m", model);
      EXPECT_EQ(size, std::filesystem::file_size(folder / "m"));
      EXPECT_EQ(size, model_file_size(model));
      const ModelFile file(folder / "m");
      const auto found = PcaModel::read(file);
      EXPECT_EQ(found->info.quantised, model.info.quantised);
      EXPECT_EQ(storage_text(found->info), storage_text(model.info));
      EXPECT_TRUE(all_equal(found->mean, model.mean));
      EXPECT_TRUE(all_equal(found->coefficients, model.coefficients));
      EXPECT_TRUE(all_equal(found->basis, model.basis));
      // and a model that was read is written as it was
      write_model(folder / "again", *found);
      EXPECT_EQ(read_bytes(folder / "again"), read_bytes(folder / "m"));
    }
  }
}

TEST(CodedModel, TensorsOfDifferentStorageStandTogether) {
  TemporaryFolder folder;
  for (const Storage rest : {Storage::f16, Storage::f32}) {
    PcaModel model = small_pca(rest);
    round_to_storage(model);
    const std::vector<float> steps{0.125f, 0};  // a component of zeros
    for (std::size_t p = 0; p < model.info.btf.shape.texels(); ++p)
      model.coefficients[2 * p + 1] = 0;
    quantise_tensor(model, 1, steps);
    write_model(folder / "m", model);
    const auto found = PcaModel::read(ModelFile(folder / "m"));
    EXPECT_EQ(found->info.quantised.size(), 1u);
    EXPECT_EQ(found->info.storage, rest);
    EXPECT_TRUE(all_equal(found->mean, model.mean));
    EXPECT_TRUE(all_equal(found->coefficients, model.coefficients));
    EXPECT_TRUE(all_equal(found->basis, model.basis));
  }
}

TEST(CodedModel, IndicesAreCodedWhereThatPays) {
  TemporaryFolder folder;
  SparseModel model = test::random_sparse({3, 4, 40, 40, 3}, {20, 60, 2, 4});
  quantise_all(model, 6);
  write_model(folder / "m", model);
  const ModelFile file(folder / "m");
  EXPECT_NE(file.file().value("coded").find("texel_atoms"), std::string_view::npos);
  const auto found = SparseModel::read(file);
  EXPECT_TRUE(all_equal(found->texels.coefficients, model.texels.coefficients));
  for (std::size_t i = 0; i < model.texels.atoms.size(); ++i) {
    ASSERT_EQ(found->texels.atoms[i], model.texels.atoms[i]);
  }
  EXPECT_EQ(found->texels.atoms.dtype(), model.texels.atoms.dtype());
}

TEST(CodedModel, ValuesThatAreNotQuantisedAreNotWritten) {
  TemporaryFolder folder;
  PcaModel model = quantised_pca(9);
  model.basis[5] *= 1.0001f;
  expect_error(ErrorKind::runtime, {"basis", "index 5", "9 bits"},
               [&] { write_model(folder / "m", model); });
  model.basis[5] = std::numeric_limits<float>::quiet_NaN();
  expect_error(ErrorKind::runtime, {"basis", "index 5", "finite"},
               [&] { write_model(folder / "m", model); });
  EXPECT_EQ(test::count_files(folder.path()), 0u);
}

TEST(CodedModel, BlobsThatAreNoneAreRefused) {
  const std::string blob = EditableModel(valid_file()).bytes_of("basis");
  for (std::size_t size = 0; size < blob.size(); size += 1 + size / 8) {
    expect_edit_refused({"\"basis\""},
                        [&](EditableModel& m) { replace(m, "basis", blob.substr(0, size)); });
  }
  expect_edit_refused({"\"basis\""}, [&](EditableModel& m) { replace(m, "basis", blob + "x"); });
  expect_edit_refused({"\"basis\""}, [&](EditableModel& m) { replace(m, "basis", blob + blob); });
  expect_edit_refused({"\"basis\""},
                      [&](EditableModel& m) { replace(m, "basis", std::string(200, 'x')); });
  expect_edit_refused({"\"basis\""},
                      [&](EditableModel& m) { replace(m, "basis", m.bytes_of("coefficients")); });
  // without new checksums, the damage itself is named
  EditableModel damaged(valid_file());
  char& byte = damaged.data[damaged.begin("basis") + 20];
  byte = static_cast<char>(byte ^ 4);
  expect_refused(damaged.file(), {"\"basis\"", "checksum"});
}

TEST(CodedModel, ClaimsThatDoNotFitAreRefused) {
  const auto field_refused = [&](const char* field, const nlohmann::json& value,
                                 std::initializer_list<std::string_view> parts) {
    SCOPED_TRACE(std::string(field) + " " + value.dump());
    expect_edit_refused(parts, [&](EditableModel& m) { set_field(m, "basis", field, value); });
  };
  for (const int bits : {0, 1, 3, 17, 64}) field_refused("bits", bits, {"coded", "basis", "bits"});
  for (const nlohmann::json& value :
       {nlohmann::json(nullptr), nlohmann::json("9"), nlohmann::json(-9), nlohmann::json(9.5)}) {
    field_refused("bits", value, {"coded", "basis", "bits"});
  }
  field_refused("bits", 4, {"\"basis\"", "4 bits"});  // codes have more
  for (const char* layout : {"", "Planes", "huffman"}) {
    field_refused("layout", layout, {"coded", "basis", "layout"});
  }
  field_refused("layout", nullptr, {"coded", "basis", "layout"});
  for (const char* dtype : {"F16", "F64", "U64", "U8"}) {
    field_refused("dtype", dtype, {"coded", "basis"});
  }
  field_refused("dtype", nullptr, {"coded", "basis", "dtype"});
  field_refused("along", 4, {"coded", "basis", "along"});
  field_refused("along", -1, {"coded", "basis", "along"});
  field_refused("along", 0, {"\"basis\"", "axis of its components"});
  field_refused("more", 1, {"coded", "basis", "more"});
  field_refused("shape", "3", {"coded", "basis", "shape"});
  field_refused("shape", {3, 3, 4}, {"\"basis\""});
  field_refused("shape", {2, 3, 4, 3}, {"\"basis\""});
  field_refused("shape", {3, 3, 4, -3}, {"coded", "basis", "shape"});
  field_refused("shape", {1 << 20, 1 << 20, 4, 3}, {"coded", "basis", "shape"});
  field_refused("shape", {std::size_t{1} << 63, 2, 1, 1}, {"coded", "basis", "shape"});
  // a claim that is possible alone, and not in a file of this size
  field_refused("shape", {1u << 30, 1, 1, 3}, {"coded", "too many"});
  for (const char* text : {"", "[]", "{", "1", R"({"basis":1})", R"({"none":{}})"}) {
    SCOPED_TRACE(text);
    expect_edit_refused({"coded"}, [&](EditableModel& m) { m.metadata()["coded"] = text; });
  }
  expect_edit_refused({"no quantised"}, [](EditableModel& m) { m.metadata().erase("coded"); });
  // as an earlier version would read it
  expect_edit_refused({"mean.step", "no quantised"},
                      [](EditableModel& m) { m.metadata()["weft.format"] = "1"; });
  // all of the model agreeing on sizes that the blobs do not have
  expect_edit_refused({"m.weft"}, [](EditableModel& m) {
    m.metadata()["shape"] = "[3,4,4096,4096,3]";
    m.rename("mask", "old.mask");
    set_field(m, "coefficients", "shape", {4096 * 4096, 3});
  });
}

TEST(CodedModel, StepsThatAreNoneAreRefused) {
  const auto put = [](EditableModel& m, float value) {
    m.data.replace(m.begin("basis.step") + 4, 4,
                   test::little_endian(std::bit_cast<std::uint32_t>(value)).substr(0, 4));
  };
  expect_edit_refused({"basis.step", "index 1", "negative"},
                      [&](EditableModel& m) { put(m, -0.5f); });
  for (const float value :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    expect_edit_refused({"basis.step", "index 1", "finite"},
                        [&](EditableModel& m) { put(m, value); });
  }
  expect_edit_refused({"\"basis\"", "step is not finite"},
                      [&](EditableModel& m) { put(m, std::numeric_limits<float>::max()); });
  expect_edit_refused({"basis.step"}, [](EditableModel& m) { m.rename("basis.step", "other"); });
  expect_edit_refused({"basis.step", "[1]", "[3]"}, [](EditableModel& m) {
    const std::string bytes = m.bytes_of("basis.step");
    m.rename("basis.step", "other");
    m.append("basis.step", "F32", {1}, bytes.substr(0, 4));
  });
  expect_edit_refused({"basis.step", "U32"},
                      [](EditableModel& m) { m.header["basis.step"]["dtype"] = "U32"; });
  expect_edit_refused({"mask.step", "no quantised"}, [](EditableModel& m) {
    m.append("mask.step", "F32", {1}, test::little_endian(0x3f800000).substr(0, 4));
  });
}

TEST(CodedModel, DamagedFilesGiveErrorsOnly) {
  TemporaryFolder folder;
  const auto path = folder / "m.weft";
  test::Random random(22);
  const EditableModel model(valid_file());
  std::size_t read = 0;
  for (int i = 0; i < 1500; ++i) {
    EditableModel edited = model;
    if (i % 2 == 0) {
      const std::size_t size = edited.data.size();
      edited.data = test::mutate(edited.data, size, random);
      edited.data.resize(size);
    } else {
      const auto text = edited.metadata()["coded"].get<std::string>();
      std::string damaged = test::mutate(text, text.size(), random);
      for (char& c : damaged) c = static_cast<char>(c & 0x7f);
      edited.metadata()["coded"] = damaged;
    }
    edited.set_checksums();
    write_bytes(path, edited.file());
    try {
      const auto found = PcaModel::read(ModelFile(path));
      std::vector<double> texel(found->info.btf.shape.channels);
      found->decode_texel(0, 0, 0, 0, texel);
      ++read;
    } catch (const Error& error) {
      ASSERT_EQ(static_cast<int>(error.kind()), 2) << error.what();
    }
  }
  EXPECT_GT(read, 0u);
}

}  // namespace
}  // namespace weft
