// weft compress --codec vq and weft enlarge, as processes.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class VqProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source({17, 16, 12, 10, 3}, DType::u8, 3);
    const auto sink = create_raw_btf(raw(), source->info());
    sink->write(0, source->info().shape.images(), source->bytes());
    sink->finish();
  }
  std::string raw() const { return folder_ / "cloth.safetensors"; }
  std::string path(const std::string& name) const { return folder_ / name; }

  TemporaryFolder folder_;
};

TEST_F(VqProcess, LuminanceIsAChannelOfItsOwn) {
  const ProcessResult made = run_weft(
      {"compress", raw(), "--codec", "vq", "--slices", "5,5,3,4", "--json", "-o", path("m.weft")});
  ASSERT_EQ(made.status, 0) << made.err;
  const json report = json::parse(made.out);
  EXPECT_EQ(report.at("colour_transform").at("name"), "ycrcb");
  EXPECT_EQ(report.at("parameters").at("grid"), "onion");
  EXPECT_EQ(report.at("parameters").at("slices"), json({5, 5, 3, 4}));
  EXPECT_EQ(run_weft({"verify", path("m.weft"), "--against", raw()}).status, 0);
  EXPECT_EQ(run_weft({"render", path("m.weft"), "--size", "16x16", "-o", path("p.png")}).status, 0);
  // scales and values of 8 bits, as the paper stores them
  const ProcessResult eight = run_weft({"compress", raw(), "--codec", "vq", "--slices", "5,5,3,4",
                                        "--storage", "q=8", "--json", "-o", path("q.weft")});
  ASSERT_EQ(eight.status, 0) << eight.err;
  EXPECT_LT(json::parse(eight.out).at("file_size"), report.at("file_size"));
  const ProcessResult plain = run_weft({"compress", raw(), "--codec", "vq", "--grid", "measured",
                                        "--transform", "none", "--json", "-o", path("n.weft")});
  ASSERT_EQ(plain.status, 0) << plain.err;
  EXPECT_EQ(json::parse(plain.out).at("colour_transform"), "none");
}

TEST_F(VqProcess, ComparesBySimilarity) {
  const ProcessResult made =
      run_weft({"compress", raw(), "--codec", "vq", "--similarity", "ssim", "--threshold", "0.3",
                "--grid", "measured", "--json", "-o", path("s.weft")});
  ASSERT_EQ(made.status, 0) << made.err;
  EXPECT_EQ(json::parse(made.out).at("parameters").at("similarity"), "ssim");
  const ProcessResult bad =
      run_weft({"compress", raw(), "--codec", "vq", "--similarity", "psnr", "-o", path("x.weft")});
  EXPECT_EQ(bad.status, 2);
  EXPECT_NE(bad.err.find("--similarity psnr: mse or ssim"), std::string::npos) << bad.err;
}

// Models of onion slices are drawn from directly and looked up in any direction, those of measured
// ones are not.
TEST_F(VqProcess, MeasuresLightsAndDirections) {
  for (const char* const grid : {"onion", "measured"}) {
    std::vector<std::string> command{"compress", raw(), "--codec", "vq", "--grid", grid};
    const bool onion = grid == std::string("onion");
    if (onion) command.insert(command.end(), {"--slices", "5,5,3,4"});
    command.insert(command.end(), {"-o", path("m.weft")});
    ASSERT_EQ(run_weft(command).status, 0);
    const ProcessResult result =
        run_weft({"bench", "--model", path("m.weft"), "--filter",
                  onion ? "lights,look_ups" : "look_ups", "--lookups", "1000", "--json"});
    ASSERT_EQ(result.status, 0) << result.err;
    const json report = json::parse(result.out);
    for (const char* const field :
         {"samples", "reference_coherent_densities", "direct_samples",
          "direct_one_core_coherent_samples", "direct_gain", "coherent_direct_gain"}) {
      if (!onion) break;
      EXPECT_GT(report.at("lights").at(field), 0) << field;
    }
    for (const char* const field : {"directions", "coherent_directions", "filtered_directions"}) {
      EXPECT_EQ(report.at("look_ups").contains(field), onion) << field;
    }
    for (const char* const device : {"auto", "reference"}) {
      EXPECT_EQ(run_weft({"render", path("m.weft"), "--size", "12x10", "--device", device, "-o",
                          path("p.png")})
                    .status,
                0);
    }
  }
}

TEST_F(VqProcess, EnlargesTheTexture) {
  ASSERT_EQ(
      run_weft({"compress", raw(), "--codec", "vq", "--grid", "measured", "-o", path("m.weft")})
          .status,
      0);
  const ProcessResult made =
      run_weft({"enlarge", path("m.weft"), "--size", "40x24", "--json", "-o", path("l.weft")});
  ASSERT_EQ(made.status, 0) << made.err;
  const ProcessResult info = run_weft({"info", path("l.weft"), "--json"});
  EXPECT_NE(info.out.find("40"), std::string::npos);
  EXPECT_EQ(run_weft({"sheet", path("l.weft"), "-o", path("l.png")}).status, 0);
  const auto expect_bad = [&](const std::vector<std::string>& arguments, const std::string& part) {
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2);
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
  };
  expect_bad({"enlarge", path("m.weft"), "--size", "0x4", "-o", path("x.weft")}, "--size: '0x4'");
  expect_bad({"enlarge", path("m.weft"), "--size", "40", "--patch", "11", "-o", path("x.weft")},
             "patches of 11");
  expect_bad({"enlarge", path("m.weft"), "-o", path("x.weft")}, "--size");
  expect_bad({"enlarge", path("m.weft"), "--size", "40", "-o", path("x.npy")}, ".weft");
  ASSERT_EQ(run_weft({"compress", raw(), "--rank", "2", "-o", path("pca.weft")}).status, 0);
  expect_bad({"enlarge", path("pca.weft"), "--size", "40", "-o", path("x.weft")}, "codec pca");
  EXPECT_EQ(run_weft({"enlarge", "--help"}).status, 0);
}

}  // namespace
}  // namespace weft::test
