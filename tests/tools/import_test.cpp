#include <fmt/format.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "support/captures.hpp"
#include "support/generators.hpp"
#include "support/image_files.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/btf/selection.hpp"
#include "weft/io/image_folder.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

namespace fs = std::filesystem;

constexpr ImageInfo small{8, 6, 3, DType::u8};

// Three views and two lights as names; seed v 10 + l.
Files ubo_files() {
  Files files;
  unsigned index = 0;
  for (const unsigned v : {0u, 1u, 2u}) {
    for (const unsigned l : {0u, 1u}) {
      files.push_back({fmt::format("tv{0:03}_pv000/{1:05} tl{2:03} pl000 tv{0:03} pv000.png",
                                   15 * v, index++, 30 * l),
                       smooth_png(small, 10 * v + l)});
    }
  }
  return files;
}

nlohmann::json import(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "import");
  arguments.push_back("--json");
  const ProcessResult result = run_weft(arguments);
  EXPECT_EQ(result.status, 0) << result.err;
  return nlohmann::json::parse(result.out);
}

void expect_refused(std::vector<std::string> arguments, const std::string& part) {
  arguments.insert(arguments.begin(), "import");
  const ProcessResult result = run_weft(arguments);
  EXPECT_EQ(result.status, 2) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_NE(result.err.find("weft import: error: "), std::string::npos) << result.err;
  EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
}

TEST(Import, UboFolderAndZipGiveTheSameRawBtf) {
  const TemporaryFolder folder;
  write_folder(folder / "ubo", ubo_files());
  write_zip(folder / "ubo.zip", ubo_files());
  std::vector<std::vector<std::byte>> values;
  for (const char* name : {"ubo", "ubo.zip"}) {
    const fs::path out = folder / "out.safetensors";
    const nlohmann::json report = import({folder / name, "-o", out});
    EXPECT_EQ(report.at("kind"), "ubo2003");
    EXPECT_EQ(report.at("shape"), nlohmann::json({3, 2, 8, 6, 3}));
    EXPECT_EQ(report.at("encoding"), "gamma2.2");
    EXPECT_EQ(report.at("ignored_images"), 0);
    values.push_back(read_all(*open_raw_btf(out)));
  }
  EXPECT_EQ(values[0], values[1]);
  const std::vector<std::byte> last = smooth_image(small, 21);
  EXPECT_TRUE(std::equal(last.begin(), last.end(), values[0].end() - 8 * 6 * 3));
}

TEST(Import, SelectsRelabelsAndConverts) {
  const TemporaryFolder folder;
  write_folder(folder / "ubo", ubo_files());
  const fs::path out = folder / "out.npy";
  const nlohmann::json report =
      import({folder / "ubo", "-o", out, "--views", "2,0", "--lights", "1", "--region", "1,2,4x4",
              "--channels", "0-1", "--level", "1", "--encoding", "srgb", "--quantity", "brdf",
              "--dtype", "f32"});
  EXPECT_EQ(report.at("shape"), nlohmann::json({2, 1, 2, 2, 2}));
  EXPECT_EQ(report.at("dtype"), "F32");
  EXPECT_EQ(report.at("selection").at("views"), nlohmann::json({2, 0}));
  const auto source = open_npy_btf(out);
  EXPECT_EQ(source->info().encoding, Encoding::srgb);
  EXPECT_EQ(source->info().quantity, Quantity::brdf);
  // The first value by hand: view 2, light 1, the mean of four texels in linear light, stored in
  // 8 bits before it becomes a float.
  const std::vector<std::byte> image = smooth_image(small, 21);
  double linear = 0;
  for (const std::size_t y : {2U, 3U}) {
    for (const std::size_t x : {1U, 2U}) {
      const double code = std::to_integer<int>(image[(y * 6 + x) * 3]) / 255.0;
      linear += decode_to_linear(Encoding::srgb, code) / 4;
    }
  }
  const double expected = nearest_byte(encode_from_linear(Encoding::srgb, linear)) / 255.0;
  EXPECT_NEAR(decode_values(read_all(*source), DType::f32)[0], expected, 0x1p-24);
}

TEST(Import, LightsElsewhereWithAMask) {
  const TemporaryFolder folder;
  Files files;
  for (unsigned i = 0; i < 12; ++i) {
    files.push_back({fmt::format("owl/owl.{}.png", i), smooth_png(small, i)});
  }
  files.push_back({"owl/owl.mask.png", smooth_png(small, 40)});
  std::string lights = "12\n";
  for (const Direction& d : even_directions(12))
    lights += fmt::format("{} {} {}\n", d[0], d[1], d[2]);
  files.push_back({"lights.txt", bytes_of_text(lights)});
  write_folder(folder / "data", files);
  const fs::path out = folder / "owl.safetensors";
  const nlohmann::json report =
      import({folder / "data/owl", "--lights-file", folder / "data/lights.txt", "-o", out});
  EXPECT_EQ(report.at("kind"), "lights");
  EXPECT_EQ(report.at("shape"), nlohmann::json({1, 12, 8, 6, 3}));
  EXPECT_EQ(report.at("mask"), true);
  std::vector<std::byte> image(small.bytes());
  open_raw_btf(out)->read(10, 1, image);
  EXPECT_EQ(image, smooth_image(small, 10));
}

TEST(Import, FlashPairs) {
  const TemporaryFolder folder;
  write_folder(folder / "cards", {{"00.png", smooth_png(small, 0)},
                                  {"01.png", smooth_png(small, 1)},
                                  {"camera_pos.txt", bytes_of_text("0,0,9\n3,0,4\n")},
                                  {"light_pos.txt", bytes_of_text("0,0,9\n3,0,4\n")}});
  const fs::path out = folder / "cards.safetensors";
  const nlohmann::json report = import({folder / "cards", "-o", out});
  EXPECT_EQ(report.at("kind"), "flash");
  EXPECT_EQ(report.at("layout"), "paired");
  EXPECT_EQ(open_raw_btf(out)->info().view_directions[1], (Direction{0.6f, 0, 0.8f}));
}

TEST(Import, AnImageFolderOfOursComesBackExactly) {
  const TemporaryFolder folder;
  const BtfShape shape{5, 7, 4, 6, 3};
  const auto data = random_source(shape, DType::f16, 4);
  ImageFolderSink sink(folder / "images", data->info(), {});
  sink.write(0, shape.images(), data->bytes());
  sink.finish();
  const fs::path out = folder / "back.safetensors";
  EXPECT_EQ(import({folder / "images", "-o", out}).at("kind"), "manifest");
  const auto back = open_raw_btf(out);
  EXPECT_EQ(back->info().view_directions, data->info().view_directions);
  EXPECT_EQ(back->info().light_directions, data->info().light_directions);
  EXPECT_EQ(read_all(*back), std::vector<std::byte>(data->bytes().begin(), data->bytes().end()));
}

TEST(Import, RawFilesAreSelectedFrom) {
  const TemporaryFolder folder;
  const BtfShape shape{4, 3, 5, 5, 3};
  const auto data = random_source(shape, DType::f32, 4);
  const auto sink = create_raw_btf(folder / "in.safetensors", data->info());
  sink->write(0, shape.images(), data->bytes());
  sink->finish();
  const fs::path out = folder / "out.safetensors";
  EXPECT_EQ(import({folder / "in.safetensors", "-o", out, "--views", "1-2"}).at("kind"), "raw");
  Selection selection;
  selection.views = std::vector<std::size_t>{1, 2};
  EXPECT_EQ(read_all(*open_raw_btf(out)), read_all(*select(data, selection)));
  EXPECT_EQ(import({out, "-o", folder / "copy.npy"}).at("shape"), nlohmann::json({2, 3, 5, 5, 3}));
  EXPECT_EQ(import({folder / "copy.npy", "-o", folder / "again.safetensors"}).at("kind"), "npy");
  EXPECT_EQ(file_bytes(folder / "again.safetensors").size(), file_bytes(out).size());
}

TEST(Import, BadRequestsAreRefusedAndLeaveNothing) {
  const TemporaryFolder folder;
  Files files = ubo_files();
  write_folder(folder / "ubo", files);
  const std::string ubo = folder / "ubo";
  const std::string out = folder / "out.safetensors";
  expect_refused({ubo, "-o", folder / "out.weft"}, "out.weft: a raw BTF ends in");
  expect_refused({ubo, "-o", folder / "out"}, "a raw BTF ends in");
  expect_refused({folder / "absent", "-o", out}, "absent: does not exist");
  expect_refused({ubo}, "--output");
  expect_refused({ubo, "-o", out, "--kind", "photos"}, "photos");
  expect_refused({ubo, "-o", out, "--views", "3"}, "--views: '3' is out of range");
  expect_refused({ubo, "-o", out, "--encoding", "log"}, "--encoding: \"log\"");
  expect_refused({ubo, "-o", out, "--dtype", "f64"}, "--dtype: 'f64'");
  expect_refused({ubo, "-o", out, "--level", "9"}, "--level 9");
  files[3].second = smooth_png({8, 7, 3, DType::u8}, 1);
  files.erase(files.begin() + 2);
  write_folder(folder / "short", files);
  expect_refused({folder / "short", "-o", out}, "1 of 6 view-light pairs");
  files = ubo_files();
  files[5].second.resize(files[5].second.size() / 2);
  write_folder(folder / "cut", files);
  expect_refused({folder / "cut", "-o", out}, "00005 tl030 pl000 tv030 pv000.png: damaged PNG");
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    EXPECT_TRUE(entry.is_directory()) << entry.path();
  }
}

TEST(Import, HelpNamesTheOptions) {
  const ProcessResult result = run_weft({"import", "--help"});
  EXPECT_EQ(result.status, 0);
  for (const char* word : {"--kind", "--manifest", "--lights-file", "--views", "--region",
                           "--level", "--encoding", "--quantity", "--dtype", "Examples:"}) {
    EXPECT_NE(result.out.find(word), std::string::npos) << word;
  }
}

}  // namespace
}  // namespace weft::test
