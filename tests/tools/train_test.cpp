// Tensor trains by the program: goals that are met by the file, cutting a train further, and how
// fast a model is decoded; each with bad usage.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class TrainProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source({5, 6, 12, 10, 3}, DType::f16, 3);
    const auto sink = create_raw_btf(path("cloth.safetensors"), source->info());
    sink->write(0, source->info().shape.images(), source->bytes());
    sink->finish();
    const ProcessResult made = compress("cloth.safetensors", "rel=0.05", "train.weft");
    ASSERT_EQ(made.status, 0) << made.err;
    report_ = json::parse(made.out);
  }

  std::string path(const std::string& name) const { return folder_ / name; }
  ProcessResult compress(const std::string& from, const std::string& target,
                         const std::string& to) const {
    return run_weft(
        {"compress", path(from), "--codec", "tt", "--target", target, "--json", "-o", path(to)});
  }

  TemporaryFolder folder_;
  json report_;
};

TEST_F(TrainProcess, MeetsGoalsAndIsCutFurther) {
  EXPECT_LE(report_.at("errors").at("relative").get<double>(), 0.05);
  EXPECT_EQ(report_.at("parameters").at("order"), "x,y,c,v,l");

  const ProcessResult cut = compress("train.weft", "rel=0.3", "shorter.weft");
  ASSERT_EQ(cut.status, 0) << cut.err;
  const json shorter = json::parse(cut.out);
  EXPECT_LE(shorter.at("errors").at("relative").get<double>(), 0.3);
  EXPECT_LT(shorter.at("file_size").get<std::size_t>(), report_.at("file_size").get<std::size_t>());

  // what was measured against the longer train is not recorded as if it were of the raw BTF
  EXPECT_EQ(shorter.at("errors_against"), path("train.weft"));
  const ProcessResult verified =
      run_weft({"verify", path("shorter.weft"), "--against", path("cloth.safetensors")});
  EXPECT_EQ(verified.status, 0) << verified.err;

  const ProcessResult sized = compress("cloth.safetensors", "size=16KiB", "small.weft");
  ASSERT_EQ(sized.status, 0) << sized.err;
  EXPECT_LE(std::filesystem::file_size(path("small.weft")), 16U << 10);
}

TEST_F(TrainProcess, KeepsItsSelection) {
  const ProcessResult part = run_weft({"compress", path("cloth.safetensors"), "--codec", "tt",
                                       "--views", "0,3", "-o", path("part.weft")});
  ASSERT_EQ(part.status, 0) << part.err;
  ASSERT_EQ(compress("part.weft", "rel=0.3", "shorter.weft").status, 0);
  for (const char* model : {"part.weft", "shorter.weft"}) {
    const ProcessResult verified =
        run_weft({"verify", path(model), "--against", path("cloth.safetensors")});
    EXPECT_EQ(verified.status, 0) << model << ": " << verified.err;
  }
}

// What of a train is cut further: views, texels and channels keep the numbers of the raw BTF, and
// what the errors are of is that part of the longer train.
TEST_F(TrainProcess, IsCutInPart) {
  const auto part = [&](std::vector<std::string> selection, const std::string& from,
                        const std::string& to) {
    std::vector<std::string> words{"compress", path(from), "--codec", "tt",    "--target",
                                   "rel=0.3",  "--json",   "-o",      path(to)};
    words.insert(words.end(), selection.begin(), selection.end());
    return run_weft(words);
  };
  const std::vector<std::string> chosen{"--views",  "1-3",     "--lights",   "0,5",
                                        "--region", "2,1,6x5", "--channels", "0,2"};
  const ProcessResult cut = part(chosen, "train.weft", "part.weft");
  ASSERT_EQ(cut.status, 0) << cut.err;
  const json report = json::parse(cut.out);
  EXPECT_EQ(report.at("shape"), (json{3, 2, 5, 6, 2}));
  EXPECT_LE(report.at("errors").at("relative").get<double>(), 0.3);
  EXPECT_EQ(report.at("selection").at("views"), (json{1, 2, 3}));
  const ProcessResult verified =
      run_weft({"verify", path("part.weft"), "--against", path("cloth.safetensors"), "--json"});
  ASSERT_EQ(verified.status, 0) << verified.err;
  // a part of a part, and its numbers
  const ProcessResult again = part({"--views", "2"}, "part.weft", "view.weft");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(json::parse(again.out).at("selection").at("views"), (json{2}));
  EXPECT_EQ(part({"--views", "4"}, "part.weft", "none.weft").status, 2);
  // levels are averages of the train itself
  const ProcessResult level = part({"--level", "1"}, "train.weft", "level.weft");
  ASSERT_EQ(level.status, 0) << level.err;
  EXPECT_EQ(json::parse(level.out).at("shape"), (json{5, 6, 6, 5, 3}));
}

TEST_F(TrainProcess, SaysHowFastItIs) {
  const ProcessResult result =
      run_weft({"bench", "--model", path("train.weft"), "--lookups", "100", "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json report = json::parse(result.out);
  EXPECT_EQ(report.at("codec"), "tt");
  EXPECT_GT(report.at("texel_time").get<double>(), 0);
  EXPECT_GT(report.at("images").at("rate").get<double>(), 0);
  EXPECT_GT(report.at("look_ups").at("unsorted").get<double>(), 0);
  EXPECT_GT(report.at("look_ups").at("filtered").get<double>(), 0);
  for (const std::string by : {"", "reference_"}) {
    for (const char* kind : {"samples", "densities", "coherent_samples", "coherent_densities"}) {
      EXPECT_GT(report.at("lights").at(by + kind).get<double>(), 0) << by << kind;
    }
  }
  EXPECT_EQ(run_weft({"bench", "--model", path("cloth.safetensors")}).status, 2);

  const ProcessResult texel =
      run_weft({"bench", "--model", path("train.weft"), "--filter", "texel", "--json"});
  ASSERT_EQ(texel.status, 0) << texel.err;
  const json one = json::parse(texel.out);
  EXPECT_GT(one.at("texel_time").get<double>(), 0);
  EXPECT_EQ(one.at("texel_operations"), one.at("parameters").at("texel_operations"));
  EXPECT_FALSE(one.contains("images"));
  EXPECT_FALSE(one.contains("look_ups"));
  EXPECT_FALSE(one.contains("lights"));
  const ProcessResult none = run_weft({"bench", "--model", path("train.weft"), "--filter", "gemm"});
  EXPECT_EQ(none.status, 2);
  EXPECT_NE(none.err.find("--filter gemm"), std::string::npos) << none.err;
}

TEST_F(TrainProcess, BadUsageIsRefused) {
  EXPECT_EQ(compress("cloth.safetensors", "rel=2", "bad.weft").status, 2);
  EXPECT_EQ(compress("cloth.safetensors", "size=100", "bad.weft").status, 1);
  const ProcessResult part = run_weft(
      {"compress", path("train.weft"), "--codec", "tt", "--views", "0-5", "-o", path("bad.weft")});
  EXPECT_EQ(part.status, 2);
  EXPECT_NE(part.err.find("0-5"), std::string::npos) << part.err;
  const ProcessResult order = run_weft({"compress", path("train.weft"), "--codec", "tt", "--order",
                                        "l,v,c,y,x", "-o", path("bad.weft")});
  EXPECT_EQ(order.status, 2);
  EXPECT_NE(order.err.find("--order l,v,c,y,x"), std::string::npos) << order.err;
  EXPECT_FALSE(std::filesystem::exists(path("bad.weft")));
}

}  // namespace
}  // namespace weft::test
