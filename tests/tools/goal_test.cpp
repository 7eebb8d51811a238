// weft compress --target and --codec auto as processes: what is reported, goals that can't be met,
// and bad usage.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class GoalProcess : public testing::Test {
 protected:
  void SetUp() override {
    const BtfShape shape{5, 6, 12, 13, 3};
    // a few directions of ever less energy, and noise
    std::vector<double> singular;
    for (int i = 0; i < 20; ++i) singular.push_back(40 * std::pow(0.7, i));
    const std::vector<double> matrix =
        matrix_with_singular_values(shape.images() * shape.channels, shape.texels(), singular, 3);
    std::vector<double> values(shape.values());
    Random random(5);
    for (std::size_t image = 0; image < shape.images(); ++image) {
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        for (std::size_t c = 0; c < shape.channels; ++c) {
          values[(image * shape.texels() + p) * shape.channels + c] =
              0.5 + matrix[(image * shape.channels + c) * shape.texels() + p] +
              0.01 * random.normal();
        }
      }
    }
    const auto source = source_of(shape, DType::f16, values);
    const auto sink = create_raw_btf(path("cloth.safetensors"), source->info());
    sink->write(0, shape.images(), source->bytes());
    sink->finish();
  }

  std::string path(const std::string& name) const { return folder_ / name; }
  ProcessResult compress(std::vector<std::string> arguments, const std::string& to) const {
    std::vector<std::string> command{"compress", path("cloth.safetensors"), "--json", "-o",
                                     path(to)};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return run_weft(command);
  }

  TemporaryFolder folder_;
};

TEST_F(GoalProcess, SaysHowTheGoalWasMet) {
  const ProcessResult made = compress({"--codec", "view-pca", "--target", "psnr=30"}, "a.weft");
  ASSERT_EQ(made.status, 0) << made.err;
  const json report = json::parse(made.out);
  EXPECT_EQ(report.at("goal").at("target"), "psnr=30");
  EXPECT_EQ(report.at("goal").at("reached"), report.at("errors").at("psnr"));
  EXPECT_GE(report.at("errors").at("psnr").get<double>(), 30);
  EXPECT_GE(report.at("goal").at("decompositions").get<int>(), 1);
  EXPECT_GE(report.at("goal").at("trials").get<int>(), 1);
  EXPECT_EQ(report.at("parameters").at("goal"), "psnr=30");
  EXPECT_EQ(run_weft({"verify", path("a.weft"), "--against", path("cloth.safetensors")}).status, 0);
  // the same bytes again, whatever the memory
  ASSERT_EQ(compress({"--codec", "view-pca", "--target", "psnr=30", "--memory", "200MiB"}, "b.weft")
                .status,
            0);
  EXPECT_EQ(std::filesystem::file_size(path("a.weft")), std::filesystem::file_size(path("b.weft")));

  const ProcessResult sized = compress({"--target", "size=12KiB"}, "c.weft");
  ASSERT_EQ(sized.status, 0) << sized.err;
  EXPECT_LE(std::filesystem::file_size(path("c.weft")), 12U << 10);
  EXPECT_EQ(json::parse(sized.out).at("codec"), "pca");
  const ProcessResult similar = compress({"--target", "ssim=0.8"}, "d.weft");
  ASSERT_EQ(similar.status, 0) << similar.err;
  EXPECT_GE(json::parse(similar.out).at("errors").at("ssim").get<double>(), 0.8);
}

TEST_F(GoalProcess, UnmetGoalsAreStatusOneAndLeaveNothing) {
  const ProcessResult bound = compress({"--target", "snr=60", "--rank", "3"}, "no.weft");
  EXPECT_EQ(bound.status, 1) << bound.err;
  EXPECT_NE(bound.err.find("--target snr=60"), std::string::npos) << bound.err;
  EXPECT_NE(bound.err.find("was reached"), std::string::npos) << bound.err;
  EXPECT_NE(bound.err.find("--rank 3"), std::string::npos) << bound.err;
  EXPECT_EQ(compress({"--target", "size=500"}, "no.weft").status, 1);
  EXPECT_EQ(compress({"--target", "psnr=92", "--storage", "f16"}, "no.weft").status, 1);
  EXPECT_FALSE(std::filesystem::exists(path("no.weft")));
  // half does not hold it, but nobody asked for half
  const ProcessResult wide = compress({"--target", "psnr=92"}, "wide.weft");
  ASSERT_EQ(wide.status, 0) << wide.err;
  EXPECT_EQ(json::parse(wide.out).at("storage"), "f32");
}

TEST_F(GoalProcess, NonsenseIsStatusTwo) {
  const std::pair<std::vector<std::string>, std::string> cases[] = {
      {{"--target", "psnr"}, "--target psnr"},
      {{"--target", "psnr=nan"}, "nan"},
      {{"--target", "ssim=2"}, "ssim=2"},
      {{"--target", "size=0"}, "size"},
      {{"--target", "ratio=1e30"}, "ratio=1e30"},
      {{"--target", "speed=3"}, "speed=3"},
      {{"--target", "psnr=30", "--tolerance", "0.1"}, "--tolerance"},
      {{"--target", "ssim=0.9", "--region", "0,0,8x8"}, "8"},
      {{"--codec", "auto"}, "--target"},
      {{"--codec", "auto", "--target", "psnr=30", "--rank", "3"}, "--rank 3"},
      {{"--codec", "pca", "--target", "psnr=30", "--prefer", "size"}, "--prefer size"},
      {{"--codec", "auto", "--target", "psnr=30", "--prefer", "beauty"}, "beauty"}};
  for (const auto& [arguments, named] : cases) {
    const ProcessResult result = compress(arguments, "no.weft");
    EXPECT_EQ(result.status, 2) << named << ": " << result.err;
    EXPECT_NE(result.err.find(named), std::string::npos) << named << ": " << result.err;
  }
  EXPECT_FALSE(std::filesystem::exists(path("no.weft")));
}

TEST_F(GoalProcess, AutoTakesTheBestCodecAndSaysWhy) {
  const ProcessResult made = compress({"--codec", "auto", "--target", "snr=20"}, "auto.weft");
  ASSERT_EQ(made.status, 0) << made.err;
  const json report = json::parse(made.out);
  EXPECT_GE(report.at("errors").at("snr").get<double>(), 20);
  const json& tried = report.at("codecs");
  std::set<std::string> names;
  for (const json& row : tried) names.insert(row.at("codec").get<std::string>());
  for (const char* codec : {"cta", "kcta", "lpca", "pca", "sparse", "tt", "tucker", "view-pca"}) {
    EXPECT_TRUE(names.contains(codec)) << codec;
  }
  EXPECT_EQ(tried.front().at("codec"), report.at("codec"));
  EXPECT_EQ(tried.front().at("outcome"), "taken");
  // all of so small an input was tried: nothing had to be foreseen
  double before = 0;
  for (const json& row : tried) {
    if (!row.at("met").get<bool>()) continue;
    EXPECT_GE(row.at("foreseen_size").get<double>(), before);
    before = row.at("foreseen_size").get<double>();
  }
  EXPECT_NEAR(tried.front().at("foreseen_size").get<double>(), report.at("file_size").get<double>(),
              0.05 * report.at("file_size").get<double>());

  for (const char* preference : {"decode", "encode"}) {
    const ProcessResult other = compress(
        {"--codec", "auto", "--target", "size=12KiB", "--prefer", preference}, "other.weft");
    ASSERT_EQ(other.status, 0) << other.err;
    EXPECT_LE(std::filesystem::file_size(path("other.weft")), 12U << 10);
    EXPECT_EQ(json::parse(other.out).at("preferred"), preference);
  }
  const ProcessResult none = compress({"--codec", "auto", "--target", "size=300"}, "no.weft");
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.err.find("tucker: "), std::string::npos) << none.err;
}

}  // namespace
}  // namespace weft::test
