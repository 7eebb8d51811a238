// Masks in model files: as bits they come back to the bit and are small, masks of older files are
// read, and blobs that are none are refused.
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "model/edit_model.hpp"
#include "model/small_pca.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/largest_allocation.hpp"
#include "support/temporary_folder.hpp"
#include "weft/model/entropy_code.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

constexpr NumberType byte_type{1, false};

std::vector<std::int32_t> random_bits(std::size_t count, double share, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::int32_t> bits(count);
  for (std::int32_t& bit : bits) bit = random.uniform() < share ? 1 : 0;
  return bits;
}

std::vector<std::byte> coded_bits(const std::vector<std::int32_t>& bits) {
  return entropy_code(bits, byte_type, CodeLayout::bits, {});
}

std::vector<std::int32_t> decoded_bits(const std::vector<std::byte>& blob, std::size_t count) {
  return entropy_decode(blob, count, byte_type, CodeLayout::bits, {}, "blob");
}

TEST(MaskBits, ComeBackWhateverTheirNumber) {
  for (const std::size_t count : Sizes{0, 1, 7, 8, 9, 15, 16, 17, 1000, 70001}) {
    for (const double share : {0.0, 0.01, 0.5, 1.0}) {
      const auto bits = random_bits(count, share, 3 + count);
      EXPECT_EQ(decoded_bits(coded_bits(bits), count), bits) << count << ", " << share;
    }
  }
}

TEST(MaskBits, BlobsThatAreNoneAreRefused) {
  const std::vector<std::byte> blob = coded_bits(random_bits(12, 1, 1));
  expect_error(ErrorKind::input, {"blob", "behind the last of 11"},
               [&] { decoded_bits(blob, 11); });
  expect_error(ErrorKind::input, {"blob", "holds"}, [&] { decoded_bits(blob, 17); });
  expect_error(ErrorKind::input, {"blob", "holds"}, [&] { decoded_bits(blob, 8); });
  std::vector<std::byte> longer = blob;
  longer.push_back(std::byte{0});
  expect_error(ErrorKind::input, {"blob", "1 bytes too many"}, [&] { decoded_bits(longer, 12); });
  for (std::size_t size = 0; size < blob.size(); ++size) {
    const std::vector<std::byte> cut(blob.begin(),
                                     blob.begin() + static_cast<std::ptrdiff_t>(size));
    expect_error(ErrorKind::input, {"blob"}, [&] { decoded_bits(cut, 12); });
  }
  expect_error(ErrorKind::runtime, {"2"}, [] { coded_bits({0, 1, 2}); });
}

constexpr BtfShape shape{7, 1, 24, 20, 3};

// A disc that wanders and grows with the view.
std::vector<std::uint8_t> disc_mask() {
  std::vector<std::uint8_t> mask;
  for (std::size_t v = 0; v < shape.views; ++v) {
    for (std::size_t y = 0; y < shape.height; ++y) {
      for (std::size_t x = 0; x < shape.width; ++x) {
        const double dx = static_cast<double>(x) - 9 - static_cast<double>(v);
        const double dy = static_cast<double>(y) - 11;
        const double radius = 4 + static_cast<double>(v);
        mask.push_back(dx * dx + dy * dy < radius * radius ? 1 : 0);
      }
    }
  }
  return mask;
}

std::vector<std::uint8_t> random_mask(double share) {
  const auto bits = random_bits(shape.views * shape.texels(), share, 8);
  return {bits.begin(), bits.end()};
}

PcaModel model_with(std::vector<std::uint8_t> mask) {
  PcaModel model = small_pca(Storage::f32, 2, 1.0, shape);
  model.info.btf.mask = std::move(mask);
  return model;
}

TEST(MaskFile, MasksComeBackToTheBit) {
  TemporaryFolder folder;
  const std::size_t values = shape.views * shape.texels();
  for (const auto& mask : {disc_mask(), random_mask(0), random_mask(1), random_mask(0.5)}) {
    const PcaModel model = model_with(mask);
    const std::size_t size = write_model(folder / "m", model);
    EXPECT_EQ(size, std::filesystem::file_size(folder / "m"));
    EXPECT_EQ(size, model_file_size(model));
    const ModelFile file(folder / "m");
    EXPECT_FALSE(file.has_occlusion());
    EXPECT_EQ(file.info().btf.mask, mask);
    EXPECT_EQ(file.file().value("weft.format"), "3");
    // a bit each, and a frame's few bytes, at most
    EXPECT_LE(file.file().get("mask").bytes(), values / 8 + 32);
    write_model(folder / "again", *PcaModel::read(file));
    EXPECT_EQ(read_bytes(folder / "again"), read_bytes(folder / "m"));
  }
  // one view of another: what is regular takes much less
  write_model(folder / "m", model_with(disc_mask()));
  EXPECT_LT(ModelFile(folder / "m").file().get("mask").bytes(), values / 16);
}

TEST(MaskFile, OfQuantisedModelsToo) {
  TemporaryFolder folder;
  PcaModel model = model_with(disc_mask());
  quantise_all(model, 9);
  write_model(folder / "m", model);
  const auto found = PcaModel::read(ModelFile(folder / "m"));
  EXPECT_EQ(found->info.btf.mask, model.info.btf.mask);
  EXPECT_EQ(found->info.quantised, model.info.quantised);
  EXPECT_EQ(found->basis, model.basis);
}

std::string valid_file() {
  TemporaryFolder folder;
  write_model(folder / "m", model_with(disc_mask()));
  return read_bytes(folder / "m");
}

// Of many models with one mask, it is packed once.
TEST(FileSizer, PacksAMaskOnce) {
  FileSizer sizer;
  for (const auto& mask : {disc_mask(), random_mask(0.5)}) {
    const std::size_t before = sizer.coded_masks();
    for (std::size_t i = 0; i < 3; ++i) {
      PcaModel model = model_with(mask);
      model.mean[0] += static_cast<float>(i);
      model.info.errors.reset();
      EXPECT_EQ(sizer.size(model), model_file_size(model));
      const std::size_t size = sizer.size(model);
      EXPECT_GT(sizer.size_with_errors(model), size);
      EXPECT_FALSE(model.info.errors);
    }
    EXPECT_EQ(sizer.coded_masks(), before + 1);
  }
  EXPECT_EQ(sizer.size(model_with({})), model_file_size(model_with({})));
}

void replace_mask(EditableModel& model, const std::vector<std::size_t>& sizes,
                  const std::string& bytes) {
  model.rename("mask", "old.mask");
  model.append("mask", "U8", sizes, bytes);
}

std::string raw_bytes(const std::vector<std::uint8_t>& mask) {
  return {mask.begin(), mask.end()};
}

// As they were before masks were packed: a byte each, in a file of format 1.
TEST(MaskFile, MasksOfOlderFilesAreRead) {
  TemporaryFolder folder;
  EditableModel model(valid_file());
  const std::vector<std::uint8_t> mask = random_mask(0.3);
  replace_mask(model, {shape.views, shape.height, shape.width}, raw_bytes(mask));
  model.metadata().erase("coded");
  model.metadata()["weft.format"] = "1";
  model.set_checksums();
  write_bytes(folder / "m", model.file());
  EXPECT_EQ(ModelFile(folder / "m").info().btf.mask, mask);
}

void expect_edit_refused(std::initializer_list<std::string_view> parts,
                         const std::function<void(EditableModel&)>& change) {
  TemporaryFolder folder;
  EditableModel model(valid_file());
  change(model);
  model.set_checksums();
  const std::string file = model.file();
  write_bytes(folder / "m.weft", file);
  reset_largest_allocation();
  expect_error(ErrorKind::input, {"m.weft"}, [&] { ModelFile opened(folder / "m.weft"); });
  EXPECT_LE(largest_allocation(), 4 * file.size() + (std::size_t{1} << 17));
  expect_error(ErrorKind::input, parts, [&] { ModelFile opened(folder / "m.weft"); });
}

void set_coded(EditableModel& model, const std::function<void(nlohmann::json&)>& change) {
  auto coded = nlohmann::json::parse(model.metadata()["coded"].get<std::string>());
  change(coded["mask"]);
  model.metadata()["coded"] = coded.dump();
}

TEST(MaskFile, WhatIsNoMaskIsRefused) {
  expect_edit_refused({"mask", "[24, 7, 20]"}, [](EditableModel& m) {
    set_coded(m, [](nlohmann::json& entry) { entry["shape"] = {24, 7, 20}; });
  });
  expect_edit_refused({"mask", "holds"}, [](EditableModel& m) {
    m.metadata()["shape"] = "[7,1,24,40,3]";
    set_coded(m, [](nlohmann::json& entry) { entry["shape"] = {7, 24, 40}; });
  });
  expect_edit_refused({"mask", "bits are of U8"}, [](EditableModel& m) {
    set_coded(m, [](nlohmann::json& entry) { entry["dtype"] = "U16"; });
  });
  expect_edit_refused({"mask", "not along an axis"}, [](EditableModel& m) {
    set_coded(m, [](nlohmann::json& entry) { entry["along"] = 1; });
  });
  // as bytes of their own, one of which is neither 0 nor 1
  expect_edit_refused({"mask", "2", "is not below 2"}, [](EditableModel& m) {
    std::vector<std::int32_t> numbers(shape.views * shape.texels());
    numbers[100] = 2;
    const auto blob = entropy_code(numbers, byte_type, CodeLayout::planes, {});
    replace_mask(m, {blob.size()}, {reinterpret_cast<const char*>(blob.data()), blob.size()});
    set_coded(m, [](nlohmann::json& entry) { entry["layout"] = "planes"; });
  });
  expect_edit_refused({"mask", "frame"}, [](EditableModel& m) {
    const std::string bytes = m.bytes_of("mask");
    replace_mask(m, {bytes.size() - 3}, bytes.substr(0, bytes.size() - 3));
  });
  expect_edit_refused({"weft.format", "5", "1 to 4"},
                      [](EditableModel& m) { m.metadata()["weft.format"] = "5"; });
  expect_edit_refused({"mask", "shape"}, [](EditableModel& m) { m.metadata().erase("coded"); });
}

}  // namespace
}  // namespace weft::test
