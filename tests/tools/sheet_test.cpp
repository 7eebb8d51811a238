#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/example_model.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/image.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

std::filesystem::path write_raw(const TemporaryFolder& folder, const std::string& name,
                                std::uint64_t seed) {
  const auto source = random_source({3, 4, 5, 6, 3}, DType::f32, seed);
  const auto sink = create_raw_btf(folder / name, source->info());
  sink->write(0, source->info().shape.images(), source->bytes());
  sink->finish();
  return folder / name;
}

TEST(Sheet, OriginalDecodedAndDifference) {
  const TemporaryFolder folder;
  const std::string output = folder / "s.png";
  const ProcessResult result =
      run_weft({"sheet", write_raw(folder, "a.safetensors", 1),
                write_raw(folder, "b.safetensors", 2), "--columns", "5", "-o", output, "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out);
  EXPECT_EQ(report.at("contact_sheet"), output);
  EXPECT_EQ(report.at("images"), 5);
  const ImageInfo info = image_info(output);
  EXPECT_EQ(info.width, 5U * (6 + 4) + 4);
  EXPECT_EQ(info.height, 3U * (5 + 4) + 4);
}

TEST(Sheet, ModelBesideItsOriginal) {
  const TemporaryFolder folder;
  const std::string output = folder / "s.png";
  const std::string raw = write_raw(folder, "a.safetensors", 1);
  const std::string model = write_pca_model(folder / "a.weft", {3, 4, 5, 6, 3});
  const ProcessResult result = run_weft({"sheet", raw, model, "--columns", "2", "-o", output});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(image_info(output).height, 3U * (5 + 4) + 4);
  const std::string other = write_pca_model(folder / "b.weft", {3, 4, 5, 7, 3});
  EXPECT_EQ(run_weft({"sheet", raw, other, "-o", output}).status, 2);
}

TEST(Sheet, ChosenImages) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder, "a.safetensors", 1);
  const std::string output = folder / "s.png";
  const ProcessResult result =
      run_weft({"sheet", raw, "--views", "0,2", "--lights", "1-3", "--quiet", "-o", output});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(image_info(output).width, 6U * (6 + 4) + 4);
}

TEST(Sheet, BadUsage) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder, "a.safetensors", 1);
  const std::string output = folder / "s.png";
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"sheet"},
           {"sheet", raw},
           {"sheet", folder / "none.safetensors", "-o", output},
           {"sheet", raw, "--views", "3", "-o", output},
           {"sheet", raw, "--columns", "0", "-o", output},
           {"sheet", raw, "--difference", "0", "-o", output},
           {"sheet", raw, "--exposure", "-1", "-o", output},
           {"sheet", raw, "-o", folder / "s.jpg"},
           {"sheet", raw, "-o", folder / "no/such/folder/s.png"}}) {
    const ProcessResult result = run_weft(arguments);
    EXPECT_GE(result.status, 2) << result.err;
    EXPECT_LE(result.status, 4) << result.err;
    EXPECT_EQ(result.err.find("weft sheet: error: "), 0U) << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(std::filesystem::exists(output));
  }
}

}  // namespace
}  // namespace weft::test
