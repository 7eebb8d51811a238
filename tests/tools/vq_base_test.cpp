// Data bases of materials and mip levels of --codec vq, as processes.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
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

class VqBaseProcess : public testing::Test {
 protected:
  void SetUp() override {
    make("wool", {17, 16, 12, 10, 3}, 3);
    make("cord", {17, 16, 4, 6, 3}, 4);
    make("felt", {17, 16, 5, 5, 3}, 5);
  }
  void make(const std::string& name, const BtfShape& shape, std::uint64_t seed) {
    const auto source = random_source(shape, DType::u8, seed);
    const auto sink = create_raw_btf(raw(name), source->info());
    sink->write(0, source->info().shape.images(), source->bytes());
    sink->finish();
  }
  std::string raw(const std::string& name) const { return folder_ / (name + ".safetensors"); }
  std::string path(const std::string& name) const { return folder_ / name; }

  json run(std::vector<std::string> arguments) const {
    arguments.emplace_back("--json");
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    return result.status == 0 ? json::parse(result.out) : json();
  }
  json compress(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"compress", "--codec", "vq", "--slices", "5,5,3,4"});
    return run(arguments);
  }
  static void expect_bad(const std::vector<std::string>& arguments, const std::string& part) {
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
  }
  // What a model decodes to, as bytes of a file.
  std::string decoded(const std::string& model) const {
    run({"decompress", model, "--dtype", "f32", "-o", path("out.npy")});
    return bytes_of(path("out.npy"));
  }
  static std::string bytes_of(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  TemporaryFolder folder_;
};

TEST_F(VqBaseProcess, MaterialsShareAFile) {
  const json made = compress({raw("wool"), raw("cord"), "--levels", "2", "-o", path("base.weft")});
  ASSERT_EQ(made.at("materials").size(), 2U);
  EXPECT_EQ(made.at("materials")[1].at("name"), "cord");
  const std::string wool = path("base.weft:wool");
  const std::string before = decoded(wool);
  const std::string old_file = bytes_of(path("base.weft"));
  // added: the others stay as they are, the file is replaced
  const json more = run({"compress", raw("felt"), "--codec", "vq", "--into", path("base.weft")});
  EXPECT_EQ(more.at("parameters").at("slices"), json({5, 5, 3, 4}));
  EXPECT_EQ(decoded(wool), before);
  EXPECT_NE(bytes_of(path("base.weft")), old_file);
  const json info = run({"info", path("base.weft")}).at("files")[0];
  EXPECT_EQ(info.at("kind"), "data base");
  ASSERT_EQ(info.at("materials").size(), 3U);
  EXPECT_EQ(info.at("materials")[2].at("name"), "felt");
  EXPECT_GT(info.at("shared_size"), info.at("materials")[0].at("own_size"));
  // every subcommand that opens a model takes a material
  const json of_one = run({"info", wool}).at("files")[0];
  EXPECT_EQ(of_one.at("kind"), "model");
  run({"verify", wool, "--against", raw("wool")});
  run({"render", wool, "--size", "16x16", "-o", path("p.png")});
  run({"sheet", wool, "-o", path("s.png")});
  run({"enlarge", wool, "--size", "20", "-o", path("large.weft")});
  run({"bench", "--model", wool, "--filter", "images"});
  const json alone = run({"reduce", wool, "-o", path("alone.weft")});
  EXPECT_LT(alone.at("file_size"), alone.at("model_size"));
  EXPECT_EQ(decoded(path("alone.weft")), before);
  // a model of one becomes a data base of two
  run({"compress", raw("felt"), "--codec", "vq", "--into", path("alone.weft"), "--names", "two",
       "-o", path("both.weft")});
  EXPECT_EQ(decoded(path("both.weft:alone")), before);
}

TEST_F(VqBaseProcess, LevelsAreKept) {
  const json made = run({"compress", "--codec", "vq", "--grid", "measured", "--threshold", "0",
                         "--levels", "3", raw("wool"), "-o", path("m.weft")});
  EXPECT_EQ(made.at("parameters").at("levels"), 3);
  // the averages of the raw BTF, in its colours
  run({"import", raw("wool"), "--level", "1", "-o", path("half.safetensors")});
  const json half = run({"decompress", path("m.weft"), "--level", "1", "-o", path("a.npy")});
  EXPECT_EQ(half.at("shape"), run({"info", path("half.safetensors")}).at("files")[0].at("shape"));
  run({"decompress", path("m.weft"), "--level", "3", "-o", path("b.npy")});
  const json level = run({"verify", path("m.weft"), "--level", "2", "--against", raw("wool")});
  EXPECT_GT(level.at("errors")[0].at("snr"), 30);
  run({"render", path("m.weft"), "--size", "8x8", "--shape", "plane", "-o", path("p.png")});
}

TEST_F(VqBaseProcess, BadUsageIsRefused) {
  compress({raw("wool"), raw("cord"), "-o", path("base.weft")});
  const std::string before = bytes_of(path("base.weft"));
  expect_bad({"decompress", path("base.weft"), "-o", path("out.npy")}, "name one of wool, cord");
  expect_bad({"info", path("base.weft:silk")}, "without a material 'silk'");
  const std::vector<std::string> into{"compress", raw("cord"), "--into", path("base.weft")};
  const auto with = [](std::vector<std::string> arguments, std::vector<std::string> more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  expect_bad(with(into, {"--codec", "vq"}), "has one of that name");
  expect_bad(into, "--codec pca");
  expect_bad(with(into, {"--codec", "vq", "--names", "a,b"}), "2 names for 1 inputs");
  expect_bad(with(into, {"--codec", "vq", "--names", "a/b"}), "'a/b'");
  expect_bad(with(into, {"--codec", "vq", "--names", "c", "--storage", "f32"}), "stored as f16");
  expect_bad(with(into, {"--codec", "vq", "--names", "c", "--slices", "5,5,3,5"}), "grid");
  expect_bad(with(into, {"--codec", "vq", "--names", "c", "--transform", "none"}), "transform");
  expect_bad(with(into, {"--codec", "vq", "--names", "c", "--weights", "cos"}), "--weights");
  expect_bad({"compress", raw("cord"), raw("cord"), "--codec", "vq", "-o", path("x.weft")},
             "two are named so");
  expect_bad({"compress", raw("cord"), raw("wool"), "--codec", "vq"}, "--output is required");
  expect_bad({"compress", raw("cord"), "--codec", "vq", "--levels", "9", "-o", path("x.weft")},
             "--levels 9");
  expect_bad({"compress", raw("cord"), "--codec", "vq", "--into", path("none.weft")}, "none.weft");
  expect_bad({"info", "--albedo", path("base.weft")}, "--albedo");
  expect_bad({"reduce", path("base.weft:cord"), "--ranks", "v=2", "-o", path("x.weft")}, "--ranks");
  // a goal that is missed, and a run that fails, leave the file as it was
  EXPECT_EQ(run_weft(with(into, {"--codec", "vq", "--names", "c", "--target", "size=1KiB"})).status,
            1);
  EXPECT_EQ(bytes_of(path("base.weft")), before);
  EXPECT_FALSE(std::filesystem::exists(path("x.weft")));
}

}  // namespace
}  // namespace weft::test
