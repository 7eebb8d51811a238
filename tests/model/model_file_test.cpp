// Model files: what they give back, their bytes, and every way in which one may be wrong.
#include "weft/model/model_file.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "model/edit_model.hpp"
#include "model/small_pca.hpp"
#include "support/expect_error.hpp"
#include "support/largest_allocation.hpp"
#include "support/mutate.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/model/pca.hpp"

namespace weft {
namespace {

using test::EditableModel;
using test::expect_error;
using test::read_bytes;
using test::small_pca;
using test::TemporaryFolder;
using test::write_bytes;

std::string written_file(Storage storage) {
  TemporaryFolder folder;
  write_model(folder / "m", small_pca(storage));
  return read_bytes(folder / "m");
}

// Written once each: flushing to disk takes its time.
const std::string& valid_file(Storage storage = Storage::f16) {
  static const std::string f16 = written_file(Storage::f16);
  static const std::string f32 = written_file(Storage::f32);
  return storage == Storage::f16 ? f16 : f32;
}

// The whole way of reading a model.
void read_model(const std::filesystem::path& path) {
  PcaModel::read(ModelFile(path));
}

void expect_refused(const std::string& file, std::initializer_list<std::string_view> parts) {
  TemporaryFolder folder;
  const auto path = folder / "m.weft";
  write_bytes(path, file);
  test::reset_largest_allocation();
  expect_error(ErrorKind::input, {"m.weft"}, [&] { read_model(path); });
  EXPECT_LE(test::largest_allocation(), 4 * file.size() + 65536);
  expect_error(ErrorKind::input, parts, [&] { read_model(path); });
}

void expect_edit_refused(std::initializer_list<std::string_view> parts,
                         const std::function<void(EditableModel&)>& change,
                         Storage storage = Storage::f16) {
  EditableModel model(valid_file(storage));
  change(model);
  model.set_checksums();
  expect_refused(model.file(), parts);
}

TEST(ModelFile, GivesBackEverythingAboutTheModel) {
  TemporaryFolder folder;
  const PcaModel model = small_pca(Storage::f16);
  write_model(folder / "m", model);
  EXPECT_TRUE(ModelFile::looks_like(folder / "m"));
  const ModelFile file(folder / "m");
  const ModelInfo& found = file.info();
  const ModelInfo& wanted = model.info;
  EXPECT_EQ(found.codec, wanted.codec);
  EXPECT_EQ(found.parameters, wanted.parameters);
  EXPECT_EQ(found.selection, wanted.selection);
  EXPECT_EQ(found.colour_transform, wanted.colour_transform);
  EXPECT_EQ(found.storage, wanted.storage);
  EXPECT_EQ(found.program_version, wanted.program_version);
  EXPECT_EQ(found.btf.shape, wanted.btf.shape);
  EXPECT_EQ(found.btf.dtype, wanted.btf.dtype);
  EXPECT_EQ(found.btf.encoding, wanted.btf.encoding);
  EXPECT_EQ(found.btf.quantity, wanted.btf.quantity);
  EXPECT_EQ(found.btf.layout, wanted.btf.layout);
  EXPECT_EQ(found.btf.view_directions, wanted.btf.view_directions);
  EXPECT_EQ(found.btf.light_directions, wanted.btf.light_directions);
  EXPECT_EQ(found.btf.channel_names, wanted.btf.channel_names);
  EXPECT_EQ(found.btf.source, wanted.btf.source);
  EXPECT_EQ(found.btf.mask, wanted.btf.mask);
  ASSERT_TRUE(found.errors.has_value());
  EXPECT_EQ(found.errors->count, wanted.errors->count);
  EXPECT_EQ(found.errors->rmse, wanted.errors->rmse);
  EXPECT_EQ(found.errors->peak, wanted.errors->peak);
  EXPECT_EQ(found.errors->psnr, wanted.errors->psnr);
  EXPECT_EQ(found.errors->snr, wanted.errors->snr);
  EXPECT_EQ(found.errors->relative, wanted.errors->relative);
  EXPECT_EQ(found.errors->max_error, wanted.errors->max_error);
}

TEST(ModelFile, GivesBackFiguresThatAreNotFinite) {
  TemporaryFolder folder;
  PcaModel model = small_pca(Storage::f32);
  constexpr double inf = std::numeric_limits<double>::infinity();
  model.info.errors->psnr = inf;
  model.info.errors->snr = std::nan("");
  model.info.errors->relative = -inf;
  write_model(folder / "m", model);
  const ModelInfo found = ModelFile(folder / "m").info();
  EXPECT_EQ(found.errors->psnr, inf);
  EXPECT_TRUE(std::isnan(found.errors->snr));
  EXPECT_EQ(found.errors->relative, -inf);
  model.info.errors.reset();
  write_model(folder / "m", model);
  EXPECT_FALSE(ModelFile(folder / "m").info().errors.has_value());
}

TEST(ModelFile, ChecksumsAreThoseOfXxh3) {
  // Published values of XXH3-64 without a seed.
  EXPECT_EQ(checksum_of({}), "2d06800538d394c2");
  EXPECT_EQ(checksum_of(std::as_bytes(std::span("abc", 3))), "78af5f94892f3950");
}

TEST(ModelFile, BytesOfATinyOne) {
  TemporaryFolder folder;
  PcaModel model;
  model.info.codec = "pca";
  model.info.program_version = "1.2.3";
  model.info.btf.shape = {1, 1, 1, 2, 1};
  model.info.btf.dtype = DType::u8;
  model.info.btf.view_directions = {{0, 0, 1}};
  model.info.btf.light_directions = {{0, 0, 1}};
  model.rank = 1;
  model.mean = {0.5f};
  model.coefficients = {1.0f, -0.25f};
  model.basis = {3.0f};
  write_model(folder / "m", model);

  std::string header =
      R"({"__metadata__":{"channel_names":"[]","checksums":"CHECKSUMS","codec":"pca",)"
      R"("colour_transform":"none","dtype":"U8","encoding":"linear","layout":"grid",)"
      R"("parameters":"{}","quantity":"radiance","selection":"{}","shape":"[1,1,1,2,1]",)"
      R"("source":"","storage":"f16","weft.format":"1","weft.version":"1.2.3"},)"
      R"("mean.scale":{"dtype":"F32","shape":[1],"data_offsets":[0,4]},)"
      R"("coefficients.scale":{"dtype":"F32","shape":[1],"data_offsets":[4,8]},)"
      R"("basis.scale":{"dtype":"F32","shape":[1],"data_offsets":[8,12]},)"
      R"("view_directions":{"dtype":"F32","shape":[1,3],"data_offsets":[12,24]},)"
      R"("light_directions":{"dtype":"F32","shape":[1,3],"data_offsets":[24,36]},)"
      R"("mean":{"dtype":"F16","shape":[1,1,1],"data_offsets":[36,38]},)"
      R"("coefficients":{"dtype":"F16","shape":[2,1],"data_offsets":[38,42]},)"
      R"("basis":{"dtype":"F16","shape":[1,1,1,1],"data_offsets":[42,44]}})";
  std::string data;
  const auto put = [&](std::uint64_t bits, std::size_t bytes) {
    data += test::little_endian(bits).substr(0, bytes);
  };
  put(0x38000000, 4);  // 2^-15: 0.5 = 2^14 2^-15
  put(0x38800000, 4);  // 2^-14
  put(0x39000000, 4);  // 2^-13: 3 = 24576 2^-13
  for (const int z : {0, 0, 1, 0, 0, 1}) put(z == 1 ? 0x3f800000 : 0, 4);
  put(0x7400, 2);  // 2^14
  put(0x7400, 2);
  put(0xec00, 2);  // -2^12
  put(0x7600, 2);  // 24576
  std::string sums;
  const auto sum = [&](const char* name, std::size_t begin, std::size_t end) {
    sums += fmt::format(R"({}\"{}\":\"{}\")", sums.empty() ? "{" : ",", name,
                        checksum_of(std::as_bytes(std::span(data)).subspan(begin, end - begin)));
  };
  sum("basis", 42, 44);
  sum("basis.scale", 8, 12);
  sum("coefficients", 38, 42);
  sum("coefficients.scale", 4, 8);
  sum("light_directions", 24, 36);
  sum("mean", 36, 38);
  sum("mean.scale", 0, 4);
  sum("view_directions", 12, 24);
  header.replace(header.find("CHECKSUMS"), 9, sums + "}");
  header.resize((8 + header.size() + 63) / 64 * 64 - 8, ' ');
  const std::string file = read_bytes(folder / "m");
  EXPECT_EQ(file, test::container(header, data));
  EXPECT_EQ(checksum_of(std::as_bytes(std::span(file))), "06b712b2cd41c299");
}

TEST(ModelFile, RefusesOtherVersionsAndOtherFiles) {
  expect_edit_refused({"weft.format 5", "1.2.3", "reads 1 to 4"},
                      [](EditableModel& m) { m.metadata()["weft.format"] = "5"; });
  expect_edit_refused({"weft.format", "new"},
                      [](EditableModel& m) { m.metadata()["weft.format"] = "new"; });
  expect_edit_refused({"weft.format"}, [](EditableModel& m) { m.metadata().erase("weft.format"); });
  expect_edit_refused({"codec", "tucker"},
                      [](EditableModel& m) { m.metadata()["codec"] = "tucker"; });
  TemporaryFolder folder;
  const BtfInfo info = test::make_info({1, 1, 1, 1, 1}, DType::u8);
  const auto sink = create_raw_btf(folder / "raw", info);
  sink->write(0, 1, std::vector<std::byte>(1));
  sink->finish();
  EXPECT_FALSE(ModelFile::looks_like(folder / "raw"));
  expect_error(ErrorKind::input, {"raw", "it is a raw BTF"}, [&] { ModelFile(folder / "raw"); });
  write_bytes(folder / "text", "anything that is long enough to hold a header");
  EXPECT_FALSE(ModelFile::looks_like(folder / "text"));
  expect_error(ErrorKind::input, {"text"}, [&] { ModelFile(folder / "text"); });
  // A damaged model is still named as one, so that its own error is shown.
  write_bytes(folder / "cut", valid_file().substr(0, 2000));
  EXPECT_TRUE(ModelFile::looks_like(folder / "cut"));
}

TEST(ModelFile, RefusesMissingAndWrongMetadata) {
  for (const char* key :
       {"weft.version", "codec", "parameters", "selection", "colour_transform", "storage", "shape",
        "dtype", "encoding", "quantity", "layout", "channel_names", "source"}) {
    expect_edit_refused({"metadata", key}, [&](EditableModel& m) { m.metadata().erase(key); });
  }
  const std::vector<std::pair<const char*, std::vector<const char*>>> wrong{
      {"codec", {""}},
      {"parameters", {"", "[]", "{", "1", R"({"a":1,"a":2})"}},
      {"selection", {"", "null", "{}x"}},
      {"colour_transform",
       {"", "log", "[]", R"({"name":"log"})", R"({"name":"log","scale":0,"largest":1})",
        R"({"name":"decorrelated","axes":[1,0,0,1]})", R"({"name":"ycrcb","weights":[1]})"}},
      {"storage", {"", "f64", "F16"}},
      {"shape",
       {"", "[]", "[2,3,4,5]", "[2,3,4,5,3,1]", "[2,3,4,5,-3]", "[2,3,4,5,3.5]", "{}",
        "[2,3,4,5,\"3\"]", "[2,3,4,5,99999999999999999999]"}},
      {"dtype", {"", "F8", "f16"}},
      {"encoding", {"", "log"}},
      {"quantity", {"", "flux"}},
      {"layout", {"", "spiral"}},
      {"channel_names", {"{}", "[1]", "[", R"("R")"}},
      {"errors",
       {"", "[]", "{}", R"({"rmse":"x"})",
        R"({"rmse":1,"psnr":null,"psnr_peak":1,"snr":1,"relative":1,"max_error":1})",
        R"({"rmse":1,"psnr":1,"psnr_peak":1,"snr":1,"relative":1,"max_error":1,"log":1})",
        R"({"rmse":1,"psnr":1,"psnr_peak":1,"snr":1,"relative":1,"max_error":1,)"
        R"("log":{"scale":0,"rmse":1,"snr":1}})"}}};
  for (const auto& [key, values] : wrong) {
    for (const char* value : values) {
      SCOPED_TRACE(value);
      expect_edit_refused({"metadata", key},
                          [&, k = key](EditableModel& m) { m.metadata()[k] = value; });
    }
  }
  expect_edit_refused({"names"},
                      [](EditableModel& m) { m.metadata()["channel_names"] = "[\"R\"]"; });
  expect_edit_refused({"light_directions", "[2, 3]"},
                      [](EditableModel& m) { m.metadata()["layout"] = "paired"; });
  for (const char* dtype : {"F64", "U16", "U32"}) {
    expect_edit_refused({"dtype", dtype}, [&](EditableModel& m) { m.metadata()["dtype"] = dtype; });
  }
}

TEST(ModelFile, RefusesShapesThatTheTensorsDoNotHave) {
  for (const char* shape : {"[2,3,5,4,1]", "[3,2,4,5,3]", "[2,3,4,4,3]", "[2,3,0,5,3]",
                            "[1152921504606846976,3,4,5,3]", "[2,3,1152921504606846976,5,3]",
                            "[2,3,4294967296,4294967296,4]", "[2,3,4,5,1152921504606846976]"}) {
    SCOPED_TRACE(shape);
    expect_edit_refused({"m.weft"}, [&](EditableModel& m) { m.metadata()["shape"] = shape; });
  }
  // With the mask gone, the texels are those of the coefficients.
  expect_edit_refused({"coefficients", "[20, 2]", "[1000000, 2]"}, [](EditableModel& m) {
    m.metadata()["shape"] = "[2,3,1000,1000,3]";
    m.rename("mask", "old");
  });
}

TEST(ModelFile, RefusesChecksumsThatDoNotMatch) {
  const std::string good = valid_file();
  const EditableModel model(good);
  // One bit of each tensor in turn.
  for (const auto& [name, tensor] : model.header.items()) {
    if (name == "__metadata__") continue;
    const std::size_t data_begin = good.size() - model.data.size();
    std::string bytes = good;
    // In the mask and the directions another check may speak first.
    const bool values = name.find("directions") == std::string::npos && name != "mask";
    char& byte = bytes[data_begin + model.begin(name)];
    byte = static_cast<char>(byte ^ 1);
    if (values) {
      expect_refused(bytes, {"\"" + name + "\"", "checksum"});
    } else {
      expect_refused(bytes, {name});
    }
  }
  const auto with = [&](const std::string& checksums) {
    EditableModel edited(good);
    edited.metadata()["checksums"] = checksums;
    return edited.file();
  };
  nlohmann::json sums =
      nlohmann::json::parse(model.header["__metadata__"]["checksums"].get<std::string>());
  expect_refused(with(""), {"checksums"});
  expect_refused(with("[]"), {"checksums"});
  expect_refused(with("{}"), {"no checksum"});
  nlohmann::json more = sums;
  more["other"] = "2d06800538d394c2";
  expect_refused(with(more.dump()), {"no tensor \"other\""});
  nlohmann::json number = sums;
  number["mean"] = 1;
  expect_refused(with(number.dump()), {"mean", "string"});
  nlohmann::json upper = sums;
  upper["mean"] = "0123456789abcdef";
  expect_refused(with(upper.dump()), {"mean", "0123456789abcdef"});
  EditableModel none(good);
  none.metadata().erase("checksums");
  expect_refused(none.file(), {"checksums"});
}

void put(EditableModel& model, const std::string& tensor, std::size_t index, std::uint64_t bits,
         std::size_t bytes) {
  model.data.replace(model.begin(tensor) + index * bytes, bytes,
                     test::little_endian(bits).substr(0, bytes));
}

TEST(ModelFile, RefusesValuesThatAreNotFinite) {
  for (const std::uint64_t bits : {0x7c00u, 0xfc00u, 0x7e00u, 0x7c01u}) {
    expect_edit_refused({"\"coefficients\"", "index 7", "finite"},
                        [&](EditableModel& m) { put(m, "coefficients", 7, bits, 2); });
  }
  for (const std::uint32_t bits : {0x7f800000u, 0xff800000u, 0x7fc00000u, 0x7f800001u}) {
    expect_edit_refused(
        {"\"basis\"", "index 35", "finite"},
        [&](EditableModel& m) { put(m, "basis", 35, bits, 4); }, Storage::f32);
    expect_edit_refused({"basis.scale", "index 1", "finite"},
                        [&](EditableModel& m) { put(m, "basis.scale", 1, bits, 4); });
  }
  expect_edit_refused({"\"more\"", "index 0", "finite"}, [](EditableModel& m) {
    m.append("more", "F64", {1}, test::little_endian(0x7ff0000000000000));
  });
  // Finite each, but not together: 2^14 or more times 2^127.
  expect_edit_refused({"\"coefficients\"", "scale", "finite"},
                      [](EditableModel& m) { put(m, "coefficients.scale", 0, 0x7f000000, 4); });
}

TEST(ModelFile, RefusesScalesThatAreNone) {
  for (const float scale : {0.0f, -1.0f, 3.0f, 1.0000001f, 0.75f}) {
    expect_edit_refused({"mean.scale", "index 0", "power of two"}, [&](EditableModel& m) {
      put(m, "mean.scale", 0, std::bit_cast<std::uint32_t>(scale), 4);
    });
  }
  expect_edit_refused({"\"mean\"", "mean.scale"},
                      [](EditableModel& m) { m.rename("mean.scale", "other"); });
  expect_edit_refused({"\"other.scale\"", "no F16"}, [](EditableModel& m) {
    m.append("other.scale", "F32", {1}, test::little_endian(0x3f800000).substr(0, 4));
  });
  expect_edit_refused({"\"mask.scale\"", "no F16"}, [](EditableModel& m) {
    m.append("mask.scale", "F32", {1}, test::little_endian(0x3f800000).substr(0, 4));
  });
  expect_edit_refused({"mean.scale", "[1, 1]"}, [](EditableModel& m) {
    m.header["mean.scale"]["shape"] = {1, 1};
  });
  expect_edit_refused({"mean.scale", "U32"},
                      [](EditableModel& m) { m.header["mean.scale"]["dtype"] = "U32"; });
  expect_edit_refused({"basis.scale", "[1]", "[2]"}, [](EditableModel& m) {
    const std::string bytes = m.bytes_of("basis.scale");
    m.rename("basis.scale", "other");
    m.append("basis.scale", "F32", {1}, bytes.substr(0, 4));
  });
}

TEST(ModelFile, RefusesTensorsStoredOtherwiseThanAnnounced) {
  expect_edit_refused({"\"mean\"", "F16", "F32"},
                      [](EditableModel& m) { m.metadata()["storage"] = "f32"; });
  expect_edit_refused(
      {"\"mean\"", "F32", "F16"}, [](EditableModel& m) { m.metadata()["storage"] = "f16"; },
      Storage::f32);
  expect_edit_refused({"\"mean\"", "U16"}, [](EditableModel& m) {
    m.header["mean"]["dtype"] = "U16";
    m.rename("mean.scale", "other");
  });
}

TEST(ModelFile, TruncatedFilesAreRefused) {
  const std::string good = valid_file();
  for (std::size_t size = 0; size < good.size(); size += 1 + size / 50) {
    expect_refused(good.substr(0, size), {"m.weft"});
  }
  expect_refused(good + "x", {"1 bytes after"});
}

// A model of index tensors, to be stored as they are.
class IndexModel final : public Model {
 public:
  std::vector<std::uint8_t> small{0, 255, 7};
  std::vector<std::uint16_t> medium{0, 65535};
  std::vector<std::uint32_t> large{0, 4294967295u, 1};

  IndexModel() {
    info.codec = "index";
    info.btf = test::make_info({1, 1, 1, 1, 1});
  }
  std::vector<ModelTensor> tensors() const override {
    return {{"small", {3}, DType::u8, std::as_bytes(std::span(small))},
            {"medium", {1, 2}, DType::u16, std::as_bytes(std::span(medium))},
            {"large", {3}, DType::u32, std::as_bytes(std::span(large))}};
  }
  std::vector<std::span<float>> real_values() override { return {}; }
  void divide(const Weights&) override {}
  void fitted_texel(std::size_t, std::size_t, std::size_t, std::size_t,
                    std::span<double>) const override {}
};

TEST(ModelFile, IndexTensorsAreCheckedAgainstTheirLimit) {
  TemporaryFolder folder;
  const IndexModel model;
  write_model(folder / "m.weft", model);
  const ModelFile file(folder / "m.weft");
  constexpr std::size_t all = std::size_t{1} << 32;
  EXPECT_EQ(file.index_tensor("small", {3}, 256), (std::vector<std::uint32_t>{0, 255, 7}));
  EXPECT_EQ(file.index_tensor("medium", {1, 2}, 65536), (std::vector<std::uint32_t>{0, 65535}));
  EXPECT_EQ(file.index_tensor("large", {3}, all), (std::vector<std::uint32_t>{0, 4294967295u, 1}));
  expect_error(ErrorKind::input, {"m.weft", "small", "255 at index 1", "255"},
               [&] { file.index_tensor("small", {3}, 255); });
  expect_error(ErrorKind::input, {"m.weft", "large", "4294967295 at index 1"},
               [&] { file.index_tensor("large", {3}, all - 1); });
  expect_error(ErrorKind::input, {"m.weft", "medium", "[1, 2]", "[2]"},
               [&] { file.index_tensor("medium", {2}, 65536); });
  expect_error(ErrorKind::input, {"m.weft", "no tensor \"none\""},
               [&] { file.index_tensor("none", {2}, 1); });
  expect_error(ErrorKind::input, {"m.weft", "view_directions", "F32"}, [&] {
    file.index_tensor("view_directions", {1, 3}, 1);
  });
  expect_error(ErrorKind::input, {"m.weft", "small", "U8"},
               [&] { file.real_tensor("small", {3}, ModelTensor::no_component_axis); });
}

TEST(WriteModel, RefusesModelsThatNoReaderWouldTake) {
  TemporaryFolder folder;
  const auto path = folder / "m.weft";
  const auto refused = [&](ErrorKind kind, std::initializer_list<std::string_view> parts,
                           const std::function<void(PcaModel&)>& change) {
    for (const Storage storage : {Storage::f16, Storage::f32}) {
      PcaModel model = small_pca(storage);
      change(model);
      expect_error(kind, parts, [&] { write_model(path, model); });
    }
  };
  refused(ErrorKind::runtime, {"m.weft", "basis", "index 3", "finite"},
          [](PcaModel& m) { m.basis[3] = std::nanf(""); });
  refused(ErrorKind::runtime, {"m.weft", "mean", "index 0", "finite"},
          [](PcaModel& m) { m.mean[0] = -std::numeric_limits<float>::infinity(); });
  refused(ErrorKind::runtime, {"m.weft", "coefficients"},
          [](PcaModel& m) { m.coefficients.pop_back(); });
  refused(ErrorKind::input, {"m.weft", "codec"}, [](PcaModel& m) { m.info.codec = ""; });
  refused(ErrorKind::input, {"m.weft", "parameters"}, [](PcaModel& m) { m.info.parameters = "x"; });
  refused(ErrorKind::input, {"m.weft", "selection"}, [](PcaModel& m) { m.info.selection = "[]"; });
  refused(ErrorKind::input, {"m.weft", "view_directions"},
          [](PcaModel& m) { m.info.btf.view_directions.pop_back(); });
  EXPECT_EQ(test::count_files(folder.path()), 0u);
  write_bytes(path, "before");
  refused(ErrorKind::runtime, {"basis"}, [](PcaModel& m) { m.basis[3] = std::nanf(""); });
  EXPECT_EQ(read_bytes(path), "before");
  EXPECT_EQ(test::count_files(folder.path()), 1u);
}

TEST(ModelFuzz, DamagedFilesGiveErrorsOnly) {
  TemporaryFolder folder;
  const auto path = folder / "m.weft";
  test::Random random(21);
  std::size_t read = 0;
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    const std::string good = valid_file(storage);
    const EditableModel model(good);
    for (int i = 0; i < 2000; ++i) {
      if (i % 4 == 0) {
        write_bytes(path, test::mutate(good, good.size(), random));
      } else if (i % 4 == 1) {
        write_bytes(path, test::mutate_header(good, random));
      } else {
        // Values, or one entry of the metadata, with checksums that are right again.
        EditableModel edited = model;
        if (i % 4 == 2) {
          const std::size_t size = edited.data.size();
          edited.data = test::mutate(edited.data, size, random);
          edited.data.resize(size);
        } else {
          auto& metadata = edited.metadata();
          auto entry = metadata.begin();
          std::advance(entry, static_cast<std::ptrdiff_t>(random.index(metadata.size())));
          const auto text = entry->get<std::string>();
          std::string damaged = test::mutate(text, text.size(), random);
          for (char& c : damaged) c = static_cast<char>(c & 0x7f);  // stays UTF-8
          *entry = damaged;
        }
        if (i % 8 < 4) edited.set_checksums();
        write_bytes(path, edited.file());
      }
      try {
        const auto found = PcaModel::read(ModelFile(path));
        const BtfShape& shape = found->info.btf.shape;
        std::vector<double> texel(shape.channels);
        found->decode_texel(shape.views - 1, shape.lights - 1, shape.height - 1, shape.width - 1,
                            texel);
        ++read;
      } catch (const Error& error) {
        ASSERT_EQ(static_cast<int>(error.kind()), 2) << error.what();
      }
    }
  }
  EXPECT_GT(read, 0u);  // free text and values may change
}

}  // namespace
}  // namespace weft
