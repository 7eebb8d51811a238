// Clustered tensor models as processes: compressed, verified, expanded, selected, bad usage.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/file_bytes.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class ClustersProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source({9, 4, 10, 8, 3}, DType::f16, 3);
    const auto sink = create_raw_btf(raw(), source->info());
    sink->write(0, source->info().shape.images(), source->bytes());
    sink->finish();
  }
  std::string raw() const { return folder_ / "cloth.safetensors"; }
  std::string path(const std::string& name) const { return folder_ / name; }
  json run(std::vector<std::string> arguments) const {
    arguments.emplace_back("--json");
    const ProcessResult result = run_weft(std::move(arguments));
    EXPECT_EQ(result.status, 0) << result.err;
    return json::parse(result.out, nullptr, false);
  }
  void expect_bad(const std::vector<std::string>& more, const std::string& text) const {
    std::vector<std::string> arguments{"compress", raw(), "-o", path("x.weft"), "--codec", "kcta"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2);
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
  }

  TemporaryFolder folder_;
};

TEST_F(ClustersProcess, AreCompressedVerifiedAndExpanded) {
  const json made = run({"compress", raw(), "--codec", "kcta", "--clusters", "3", "--mixtures", "2",
                         "--ranks", "v=2,lc=5,y=4,x=4", "--iterations", "3", "-o", path("m.weft")});
  EXPECT_EQ(made.at("codec"), "kcta");
  EXPECT_EQ(made.at("parameters").at("clusters"), 3);
  EXPECT_EQ(made.at("parameters").at("ranks").at("lc"), 5);
  EXPECT_EQ(made.at("parameters").at("global"), "lc");
  run({"verify", path("m.weft"), "--against", raw()});
  run({"verify", path("m.weft"), "--expand", "y,x", "--against", raw()});
  run({"decompress", path("m.weft"), "--expand", "y,x", "-o", path("e.npy")});
  run({"decompress", path("m.weft"), "-o", path("m.npy")});
  EXPECT_EQ(std::filesystem::file_size(path("e.npy")), std::filesystem::file_size(path("m.npy")));
  run({"decompress", path("m.weft"), "--views", "2,5", "--region", "1,2,4x3", "-o", path("p.npy")});
  EXPECT_EQ(run({"info", path("m.weft")}).at("files").at(0).at("codec"), "kcta");
}

TEST_F(ClustersProcess, ViewsAreResampledForPictures) {
  const std::vector<std::string> asked{"compress",     raw(), "--codec", "kcta",
                                       "--clusters",   "3",   "--ranks", "v=2,y=4,x=4",
                                       "--iterations", "2"};
  const auto made = [&](const std::string& name, std::vector<std::string> more) {
    std::vector<std::string> arguments = asked;
    arguments.insert(arguments.end(), more.begin(), more.end());
    arguments.insert(arguments.end(), {"-o", path(name)});
    return run(arguments);
  };
  const json plain = made("p.weft", {});
  const json dense = made("d.weft", {"--resample-views", "16"});
  EXPECT_EQ(dense.at("parameters").at("resample_views"), 16);
  // what is decoded in bulk is the same
  run({"verify", path("d.weft"), "--against", raw()});
  run({"decompress", path("p.weft"), "-o", path("p.npy")});
  run({"decompress", path("d.weft"), "-o", path("d.npy")});
  EXPECT_EQ(read_bytes(path("p.npy")), read_bytes(path("d.npy")));
  EXPECT_GT(std::filesystem::file_size(path("d.weft")),
            std::filesystem::file_size(path("p.weft")) + 256 * 3 * 5);
  for (const char* device : {"auto", "reference"}) {
    run({"render", path("d.weft"), "--size", "24", "--device", device, "-o", path("d.png")});
  }
  run({"render", path("p.weft"), "--size", "24", "-o", path("p.png")});
  EXPECT_NE(read_bytes(path("p.png")), read_bytes(path("d.png")));
  expect_bad({"--resample-views", "2000"}, "--resample-views 2000");
  expect_bad({"--resample-views", "4", "--mode", "y"}, "clusters are of mode y");
}

TEST_F(ClustersProcess, HardClustersAreACodecOfTheirOwn) {
  const json made =
      run({"compress", raw(), "--codec", "cta", "--clusters", "3", "--rank", "4", "--init",
           "random", "--global", "none", "--device", "reference", "-o", path("m.weft")});
  EXPECT_EQ(made.at("codec"), "cta");
  EXPECT_EQ(made.at("parameters").at("mixtures"), 1);
  run({"verify", path("m.weft"), "--against", raw()});
}

TEST_F(ClustersProcess, BadUsageIsNamed) {
  expect_bad({"--clusters", "10"}, "--clusters 10: mode v has 9 slices");
  expect_bad({"--clusters", "2", "--mixtures", "3"}, "--mixtures 3");
  expect_bad({"--ranks", "x=9"}, "mode x");
  expect_bad({"--mode", "w"}, "--mode w");
  const ProcessResult mixed =
      run_weft({"compress", raw(), "--codec", "cta", "--mixtures", "2", "-o", path("x.weft")});
  EXPECT_EQ(mixed.status, 2);
  EXPECT_NE(mixed.err.find("--mixtures 2: not a parameter of codec cta"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(path("x.weft")));
}

}  // namespace
}  // namespace weft::test
