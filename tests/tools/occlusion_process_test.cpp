// Masks by the program: models of them in every subcommand, what is reported of them, and bad
// usage.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

constexpr BtfShape shape{6, 5, 16, 14, 3};

// A net whose threads shift with the view, of which nothing is stored but the mask.
class OcclusionProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source(shape, DType::f16, 3);
    BtfInfo info = source->info();
    for (std::size_t v = 0; v < shape.views; ++v) {
      for (std::size_t y = 0; y < shape.height; ++y) {
        for (std::size_t x = 0; x < shape.width; ++x) {
          info.mask.push_back((x + v) % 14 < 5 || (y + v) % 16 < 6 ? 1 : 0);
        }
      }
    }
    write("net.safetensors", info, *source);
    info.mask.clear();
    write("cloth.safetensors", info, *source);
  }

  void write(const std::string& name, const BtfInfo& info, const MemorySource& source) const {
    const auto sink = create_raw_btf(path(name), info);
    sink->write(0, shape.images(), source.bytes());
    sink->finish();
  }

  std::string path(const std::string& name) const { return folder_ / name; }
  BtfInfo raw(const std::string& name) const { return open_raw_btf(path(name))->info(); }

  ProcessResult compress(const std::string& to, const std::vector<std::string>& options,
                         const std::string& from = "net.safetensors") const {
    std::vector<std::string> arguments{"compress", path(from), "--rank", "3",
                                       "--json",   "-o",       path(to)};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return run_weft(arguments);
  }

 private:
  TemporaryFolder folder_;
};

TEST_F(OcclusionProcess, EverySubcommandTakesTheModels) {
  const std::vector<std::string> codecs{"tucker --ranks v=4,y=6,x=6", "tt --ranks 6,5,5,1",
                                        "cta --clusters 2 --ranks v=2,y=6,x=6",
                                        "kcta --clusters 3 --mixtures 2 --ranks v=1,y=6,x=6"};
  for (const std::string& codec : codecs) {
    SCOPED_TRACE(codec);
    const ProcessResult made = compress("m.weft", {"--occlusion", codec});
    ASSERT_EQ(made.status, 0) << made.err;
    const json report = json::parse(made.out);
    EXPECT_EQ(report.at("mask"), true);
    const json& occlusion = report.at("occlusion");
    EXPECT_EQ(occlusion.at("codec"), codec.substr(0, codec.find(' ')));
    EXPECT_EQ(occlusion.at("of"), "distance");
    EXPECT_EQ(occlusion.at("texels"), shape.views * shape.texels());
    const std::size_t wrong = occlusion.at("error_texels");
    EXPECT_LT(wrong, shape.views * shape.texels() / 5);
    EXPECT_EQ(occlusion.at("threshold"), 0.05);
    EXPECT_EQ(occlusion.at("weight"), 12);

    const ProcessResult info = run_weft({"info", path("m.weft"), "--json"});
    ASSERT_EQ(info.status, 0) << info.err;
    EXPECT_EQ(json::parse(info.out).at("files").at(0).at("occlusion"), occlusion);

    const ProcessResult verified =
        run_weft({"verify", path("m.weft"), "--against", path("net.safetensors"), "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    const json check = json::parse(verified.out);
    EXPECT_EQ(check.at("mask_device_against_reference").at("agree"), true);
    ASSERT_EQ(check.at("error_texels").size(), 3U);
    for (const json& row : check.at("error_texels")) EXPECT_EQ(row.at("error_texels"), wrong);

    ASSERT_EQ(run_weft({"decompress", path("m.weft"), "-o", path("d.safetensors")}).status, 0);
    const BtfInfo decoded = raw("d.safetensors");
    const BtfInfo original = raw("net.safetensors");
    std::size_t differing = 0;
    for (std::size_t i = 0; i < original.mask.size(); ++i) {
      differing += decoded.mask.at(i) != original.mask[i] ? 1 : 0;
    }
    EXPECT_EQ(differing, wrong);
    EXPECT_EQ(decoded.mask_distance.size(), original.mask.size());
    EXPECT_EQ(run_weft({"render", path("m.weft"), "--size", "16x16", "-o", path("p.png")}).status,
              0);
  }
}

// A grid of views belongs to the model of the values alone, also where the mask's is clustered.
TEST_F(OcclusionProcess, MasksBesideResampledViews) {
  const ProcessResult made = run_weft(
      {"compress", path("net.safetensors"), "--codec", "kcta", "--clusters", "3", "--mixtures", "2",
       "--ranks", "v=1,lc=4,y=6,x=6", "--resample-views", "8", "--occlusion",
       "kcta --clusters 3 --mixtures 2 --ranks v=1,y=6,x=6", "-o", path("m.weft")});
  ASSERT_EQ(made.status, 0) << made.err;
  const ProcessResult verified =
      run_weft({"verify", path("m.weft"), "--against", path("net.safetensors")});
  EXPECT_EQ(verified.status, 0) << verified.err;
  const ProcessResult rendered =
      run_weft({"render", path("m.weft"), "--size", "16x16", "-o", path("p.png")});
  EXPECT_EQ(rendered.status, 0) << rendered.err;
}

TEST_F(OcclusionProcess, PartsDecodeAsTheWhole) {
  ASSERT_EQ(compress("m.weft", {"--occlusion", "tt --ranks 6,5,5,1"}).status, 0);
  ASSERT_EQ(run_weft({"decompress", path("m.weft"), "-o", path("d.safetensors")}).status, 0);
  ASSERT_EQ(run_weft({"decompress", path("m.weft"), "--views", "4,1", "--region", "2,3,8x9", "-o",
                      path("p.safetensors")})
                .status,
            0);
  const BtfInfo whole = raw("d.safetensors");
  const BtfInfo part = raw("p.safetensors");
  std::size_t i = 0;
  for (const std::size_t view : {4, 1}) {
    for (std::size_t y = 3; y < 12; ++y) {
      for (std::size_t x = 2; x < 10; ++x, ++i) {
        EXPECT_EQ(part.mask.at(i), whole.mask[view * shape.texels() + y * shape.width + x]);
      }
    }
  }
  ASSERT_EQ(run_weft({"decompress", path("m.weft"), "--level", "1", "--device", "reference", "-o",
                      path("l.safetensors")})
                .status,
            0);
  Selection level;
  level.level = 1;
  EXPECT_EQ(raw("l.safetensors").mask, select(whole, level).mask);
  for (const std::vector<std::string>& options :
       {std::vector<std::string>{"--level", "1"}, {"--views", "0-2", "--region", "0,0,8x8"}}) {
    std::vector<std::string> verify{"verify", path("m.weft"), "--against", path("net.safetensors")};
    verify.insert(verify.end(), options.begin(), options.end());
    const ProcessResult verified = run_weft(verify);
    EXPECT_EQ(verified.status, 0) << verified.err;
  }
}

TEST_F(OcclusionProcess, MasksAreKeptExactly) {
  for (const std::vector<std::string>& options :
       {std::vector<std::string>{}, {"--occlusion", "exact"}}) {
    const ProcessResult made = compress("m.weft", options);
    ASSERT_EQ(made.status, 0) << made.err;
    EXPECT_FALSE(json::parse(made.out).contains("occlusion"));
    EXPECT_EQ(read_model(path("m.weft"))->info.btf.mask, raw("net.safetensors").mask);
    const ProcessResult verified =
        run_weft({"verify", path("m.weft"), "--against", path("net.safetensors"), "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    EXPECT_EQ(json::parse(verified.out).at("error_texels").at(0).at("error_texels"), 0);
  }
}

TEST_F(OcclusionProcess, GoalsAndMappings) {
  const ProcessResult made =
      compress("m.weft", {"--occlusion", "tucker --storage f32", "--occlusion-errors", "0.5%",
                          "--occlusion-threshold", "0.1", "--occlusion-weight", "10"});
  ASSERT_EQ(made.status, 0) << made.err;
  const json occlusion = json::parse(made.out).at("occlusion");
  EXPECT_LE(occlusion.at("error_texels"), shape.views * shape.texels() / 200);
  EXPECT_EQ(occlusion.at("threshold"), 0.1);
  EXPECT_EQ(occlusion.at("weight"), 10);
  EXPECT_EQ(occlusion.at("storage"), "f32");
  const ProcessResult binary = compress(
      "b.weft", {"--occlusion", "tt --target rel=0.2 --storage q=8", "--occlusion-of", "mask"});
  ASSERT_EQ(binary.status, 0) << binary.err;
  EXPECT_EQ(json::parse(binary.out).at("occlusion").at("of"), "mask");
  EXPECT_EQ(json::parse(binary.out).at("occlusion").at("storage"), "q=8");
  EXPECT_EQ(json::parse(binary.out).at("occlusion").at("threshold"), 0.5);
  // pictures by another mapping than the model's; a train goes on with the model of its mask
  const ProcessResult pictured = run_weft({"render", path("m.weft"), "--occlusion-weight", "3",
                                           "--size", "16x16", "--json", "-o", path("p.png")});
  ASSERT_EQ(pictured.status, 0) << pictured.err;
  EXPECT_EQ(json::parse(pictured.out).at("occlusion_threshold"), 0.1);
  EXPECT_EQ(json::parse(pictured.out).at("occlusion_weight"), 3);
  const ProcessResult train =
      run_weft({"compress", path("net.safetensors"), "--codec", "tt", "--target", "rel=0.2",
                "--occlusion", "tt --target rel=0.2", "-o", path("t.weft")});
  ASSERT_EQ(train.status, 0) << train.err;
  ASSERT_EQ(run_weft({"compress", path("t.weft"), "--codec", "tt", "--target", "rel=0.4", "-o",
                      path("shorter.weft")})
                .status,
            0);
  EXPECT_TRUE(read_model(path("shorter.weft"))->info.occlusion);
}

TEST_F(OcclusionProcess, BadUsage) {
  struct Case {
    std::vector<std::string> options;
    std::vector<std::string> named;
    int status = 2;
  };
  const std::vector<Case> cases{
      {{"--occlusion", "jpeg"}, {"jpeg"}},
      {{"--occlusion", ""}, {"--occlusion"}},
      {{"--occlusion", "tt --clusters 3"}, {"--clusters 3", "tt"}},
      {{"--occlusion", "tt --ranks"}, {"--ranks", "without a value"}},
      {{"--occlusion", "tt 3"}, {"'3'", "no option"}},
      {{"--occlusion", "tt --storage f64"}, {"f64"}},
      {{"--occlusion", "tt --target rel=0.1", "--occlusion-errors", "3"}, {"--target rel=0.1"}},
      {{"--occlusion", "tt", "--occlusion-errors", "-1"}, {"--occlusion-errors", "-1"}},
      {{"--occlusion", "tt", "--occlusion-errors", "1.5"}, {"--occlusion-errors", "1.5"}},
      {{"--occlusion", "tt", "--occlusion-errors", "101%"}, {"--occlusion-errors", "101%"}},
      {{"--occlusion", "tt", "--occlusion-errors", "nan"}, {"--occlusion-errors", "nan"}},
      {{"--occlusion", "tt", "--occlusion-threshold", "-1"}, {"--occlusion-threshold"}},
      {{"--occlusion", "tt", "--occlusion-threshold", "nan"}, {"--occlusion-threshold"}},
      {{"--occlusion", "tt", "--occlusion-weight", "0"}, {"--occlusion-weight"}},
      {{"--occlusion", "tt", "--occlusion-band", "0"}, {"--occlusion-band"}},
      {{"--occlusion-weight", "3"}, {"--occlusion-weight", "--occlusion"}},
      {{"--occlusion-errors", "3"}, {"--occlusion-errors"}},
      {{"--occlusion-of", "mask"}, {"--occlusion-of"}},
      {{"--occlusion", "tucker --ranks v=1,y=1,x=1", "--occlusion-errors", "0"},
       {"--occlusion-errors 0"},
       1}};
  for (const Case& one : cases) {
    const ProcessResult result = compress("bad.weft", one.options);
    EXPECT_EQ(result.status, one.status) << one.options[1] << result.err;
    for (const std::string& name : one.named) {
      EXPECT_NE(result.err.find(name), std::string::npos) << result.err;
    }
  }
  const ProcessResult no_mask = compress("bad.weft", {"--occlusion", "tt"}, "cloth.safetensors");
  EXPECT_EQ(no_mask.status, 2);
  EXPECT_NE(no_mask.err.find("no mask"), std::string::npos) << no_mask.err;
  const ProcessResult pictured = run_weft({"render", path("cloth.safetensors"), "--size", "16x16",
                                           "--occlusion-weight", "3", "-o", path("p.png")});
  EXPECT_EQ(pictured.status, 2);
  EXPECT_NE(pictured.err.find("--occlusion-weight"), std::string::npos) << pictured.err;
}

}  // namespace
}  // namespace weft::test
