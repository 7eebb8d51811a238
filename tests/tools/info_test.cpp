#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/example_model.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

const BtfShape shape{3, 4, 5, 6, 3};

void write_all(TileSink& sink, MemorySource& source) {
  sink.write(0, source.info().shape.images(), source.bytes());
  sink.finish();
}

std::filesystem::path write_raw(const TemporaryFolder& folder) {
  const std::filesystem::path path = folder / "cloth.safetensors";
  const auto source = random_source(shape, DType::f16, 1);
  write_all(*create_raw_btf(path, source->info()), *source);
  return path;
}

std::filesystem::path write_pca(const TemporaryFolder& folder) {
  return write_pca_model(folder / "cloth.weft", shape);
}

TEST(Info, RawFile) {
  const TemporaryFolder folder;
  const std::filesystem::path path = write_raw(folder);
  const ProcessResult result = run_weft({"info", "--json", path});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out).at("files").at(0);
  EXPECT_EQ(report.at("file"), path.string());
  EXPECT_EQ(report.at("kind"), "raw BTF");
  EXPECT_EQ(report.at("shape"), nlohmann::json({3, 4, 5, 6, 3}));
  EXPECT_EQ(report.at("dtype"), "F16");
  EXPECT_EQ(report.at("encoding"), "linear");
  EXPECT_EQ(report.at("view_directions").size(), 3U);
  EXPECT_EQ(report.at("light_directions").size(), 4U);
  EXPECT_EQ(report.at("raw_size"), 3U * 4 * 5 * 6 * 3 * 2);
  EXPECT_EQ(report.at("file_size"), std::filesystem::file_size(path));
  EXPECT_EQ(report.at("tensors").size(), 3U);
}

TEST(Info, NpyFile) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder / "cloth.npy";
  const auto source = random_source(shape, DType::u8, 1);
  write_all(*create_npy_btf(path, source->info()), *source);
  const ProcessResult result = run_weft({"info", "--json", path});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out).at("files").at(0);
  EXPECT_EQ(report.at("dtype"), "U8");
  EXPECT_EQ(report.at("encoding"), "srgb");
}

TEST(Info, Model) {
  const TemporaryFolder folder;
  const std::filesystem::path path = write_pca(folder);
  const ProcessResult result = run_weft({"info", "--json", path});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out).at("files").at(0);
  EXPECT_EQ(report.at("kind"), "model");
  EXPECT_EQ(report.at("codec"), "pca");
  EXPECT_EQ(report.at("parameters").at("rank"), 2);
  EXPECT_EQ(report.at("storage"), "f32");
  EXPECT_EQ(report.at("errors").at("rmse"), 0.125);
  EXPECT_EQ(report.at("errors").at("psnr"), 18.0625);
  const double bytes = static_cast<double>(std::filesystem::file_size(path));
  EXPECT_EQ(report.at("ratio").get<double>(), 3.0 * 4 * 5 * 6 * 3 * 2 / bytes);
}

// Of every view, and the same of a raw BTF and of a model that holds it.
TEST(Info, Albedo) {
  const TemporaryFolder folder;
  const std::filesystem::path raw = write_raw(folder), model = folder / "whole.weft";
  ASSERT_EQ(run_weft({"compress", raw, "--rank", "30", "--storage", "f32", "-o", model}).status, 0);
  const ProcessResult result = run_weft({"info", "--albedo", "--json", raw, model});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json files = nlohmann::json::parse(result.out).at("files");
  for (std::size_t view = 0; view < shape.views; ++view) {
    const nlohmann::json of_raw = files.at(0).at("albedo").at(view);
    const nlohmann::json of_model = files.at(1).at("albedo").at(view);
    EXPECT_EQ(of_raw.at("view").get<std::size_t>(), view);
    for (const char* channel : {"red", "green", "blue"}) {
      // means of even values in [0, 1] over the hemisphere, 2 pi, some of it fading to the horizon
      EXPECT_GT(of_raw.at(channel).get<double>(), 0.25 * 6.28);
      EXPECT_LT(of_raw.at(channel).get<double>(), 0.75 * 6.28);
      EXPECT_NEAR(of_model.at(channel).get<double>(), of_raw.at(channel).get<double>(), 1e-3);
    }
  }
  const ProcessResult without = run_weft({"info", "--json", raw});
  EXPECT_FALSE(nlohmann::json::parse(without.out).at("files").at(0).contains("albedo"));
}

TEST(Info, TableForPeople) {
  const TemporaryFolder folder;
  const ProcessResult result = run_weft({"info", write_raw(folder), write_pca(folder)});
  ASSERT_EQ(result.status, 0) << result.err;
  for (const char* line : {"shape             V 3 x L 4 x Y 5 x X 6 x C 3\n",
                           "kind              model\n", "codec             pca\n", "\n\nfile "}) {
    EXPECT_NE(result.out.find(line), std::string::npos) << line << "not in\n" << result.out;
  }
  EXPECT_EQ(run_weft({"info", "--quiet", write_raw(folder)}).out, "");
}

TEST(Info, DamagedModelIsRefused) {
  const TemporaryFolder folder;
  const std::filesystem::path path = write_pca(folder);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(-1, std::ios::end);
  const char last = static_cast<char>(file.get());
  file.seekp(-1, std::ios::end);
  file.put(static_cast<char>(last ^ 1));
  file.close();
  const ProcessResult result = run_weft({"info", path});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_NE(result.err.find(path.string()), std::string::npos) << result.err;
}

TEST(Info, OneBadFileHidesNothingAboutTheOthers) {
  const TemporaryFolder folder;
  std::ofstream(folder / "text.safetensors") << "this is no BTF";
  const std::string bad = folder / "text.safetensors";
  const ProcessResult result = run_weft({"info", "--json", bad, write_raw(folder)});
  EXPECT_EQ(result.status, 2);
  const nlohmann::json files = nlohmann::json::parse(result.out).at("files");
  EXPECT_NE(files.at(0).at("error").get<std::string>().find(bad), std::string::npos);
  EXPECT_EQ(files.at(1).at("kind"), "raw BTF");
  EXPECT_NE(result.err.find(bad), std::string::npos) << result.err;
}

TEST(Info, MissingFileAndMissingArgument) {
  const TemporaryFolder folder;
  const ProcessResult missing = run_weft({"info", folder / "none.weft"});
  EXPECT_EQ(missing.status, 2);
  EXPECT_NE(missing.err.find("none.weft"), std::string::npos) << missing.err;
  const ProcessResult none = run_weft({"info"});
  EXPECT_EQ(none.status, 2);
  EXPECT_EQ(none.err.find("weft info: error: "), 0U) << none.err;
  EXPECT_EQ(run_weft({"info", folder.path()}).status, 2);
}

}  // namespace
}  // namespace weft::test
