// Weights by the program: what compress reports and stores, zeros as selections, what verify asks
// for, and bad usage.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class WeightsProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source({5, 6, 12, 10, 3}, DType::f16, 3);
    BtfInfo info = source->info();
    info.view_directions[4] = direction_from_degrees(90, 30);
    const auto sink = create_raw_btf(path("cloth.safetensors"), info);
    sink->write(0, info.shape.images(), source->bytes());
    sink->finish();
  }

  std::string path(const std::string& name) const { return folder_ / name; }

  void write_weights(const std::string& name, const std::vector<std::size_t>& shape,
                     const std::vector<float>& values) const {
    std::ofstream file(path(name), std::ios::binary);
    file << make_npy_header(DType::f32, shape);
    file.write(reinterpret_cast<const char*>(values.data()),
               static_cast<std::streamsize>(values.size() * sizeof(float)));
  }

  ProcessResult compress(const std::string& to, std::vector<std::string> options) const {
    std::vector<std::string> arguments{"compress", path("cloth.safetensors"), "--json", "-o",
                                       path(to)};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return run_weft(arguments);
  }

  // The tensors of a model file.
  std::vector<std::byte> tensors(const std::string& name) const {
    std::vector<std::byte> bytes;
    const auto model = read_model(path(name));
    for (const ModelTensor& tensor : model->tensors()) {
      bytes.insert(bytes.end(), tensor.values.begin(), tensor.values.end());
    }
    return bytes;
  }

 private:
  TemporaryFolder folder_;
};

TEST_F(WeightsProcess, EverySubcommandTakesTheModels) {
  for (const Codec* codec : codecs()) {
    SCOPED_TRACE(codec->name());
    const std::string name(codec->name());
    std::vector<std::string> options{"--codec", name, "--rank", "3", "--weights", "cos"};
    if (name == "sparse")
      options = {"--codec", name, "--atoms", "16", "--k1", "2", "--k2", "2", "--weights", "cos"};
    if (name == "tucker") {
      options = {"--codec", name, "--ranks", "v=3,l=3,y=6,x=6", "--weights", "cos"};
    }
    if (!codec->takes_weights()) options = {"--codec", name, "--weights", "cos"};
    const ProcessResult made = compress("m.weft", options);
    if (!codec->takes_weights()) {
      EXPECT_EQ(made.status, 2);
      EXPECT_NE(made.err.find("codec " + name), std::string::npos) << made.err;
      continue;
    }
    ASSERT_EQ(made.status, 0) << made.err;
    const json report = json::parse(made.out);
    EXPECT_EQ(report.at("weights").at("given"), "cos");
    const double weighted = report.at("weighted_errors").at("rmse");
    EXPECT_GT(weighted, 0);
    EXPECT_NE(weighted, report.at("errors").at("rmse").get<double>());
    // the view at 90 degrees is not selected
    EXPECT_EQ(report.at("selection").at("views"), (json{0, 1, 2, 3}));

    const ProcessResult verified =
        run_weft({"verify", path("m.weft"), "--against", path("cloth.safetensors"), "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    const json check = json::parse(verified.out);
    ASSERT_EQ(check.at("weighted_errors").size(), 3U);
    for (const json& row : check.at("weighted_errors")) {
      EXPECT_NEAR(row.at("rmse").get<double>(), weighted, 1e-4 * weighted);
    }
    const ProcessResult info = run_weft({"info", path("m.weft"), "--json"});
    ASSERT_EQ(info.status, 0) << info.err;
    EXPECT_EQ(json::parse(info.out).at("files").at(0).at("weights").at("given"), "cos");
    EXPECT_EQ(run_weft({"decompress", path("m.weft"), "-o", path(name + ".npy")}).status, 0);
    EXPECT_EQ(run_weft({"render", path("m.weft"), "--size", "16x16", "-o", path("p.png")}).status,
              0);
  }
}

TEST_F(WeightsProcess, ReferenceFitsAlike) {
  const std::vector<std::string> options{"--codec", "pca", "--rank", "3", "--weights", "cos"};
  std::vector<std::string> by_reference = options;
  by_reference.insert(by_reference.end(), {"--device", "reference"});
  const ProcessResult device = compress("d.weft", options);
  const ProcessResult reference = compress("r.weft", by_reference);
  ASSERT_EQ(device.status + reference.status, 0) << device.err << reference.err;
  const double expected = json::parse(reference.out).at("weighted_errors").at("rmse");
  EXPECT_NEAR(json::parse(device.out).at("weighted_errors").at("rmse").get<double>(), expected,
              1e-3 * expected);
}

TEST_F(WeightsProcess, EqualWeightsAreNone) {
  write_weights("v.npy", {5}, std::vector<float>(5, 2.5f));
  ASSERT_EQ(compress("plain.weft", {"--rank", "3"}).status, 0);
  const ProcessResult made =
      compress("w.weft", {"--rank", "3", "--weights", "views=" + path("v.npy")});
  ASSERT_EQ(made.status, 0) << made.err;
  EXPECT_EQ(tensors("w.weft"), tensors("plain.weft"));
  const json report = json::parse(made.out);
  EXPECT_NEAR(report.at("weighted_errors").at("rmse").get<double>(),
              report.at("errors").at("rmse").get<double>(), 1e-6);
}

// What has weight zero is as if it were not selected, bit for bit.
TEST_F(WeightsProcess, ZerosAreSelections) {
  write_weights("v.npy", {5}, {0, 1, 1, 0, 1});
  std::vector<float> texels(12 * 10, 0.0f);
  for (std::size_t y = 2; y < 9; ++y) {
    for (std::size_t x = 3; x < 8; ++x) texels[y * 10 + x] = 1;
  }
  write_weights("t.npy", {12, 10}, texels);
  const ProcessResult weighted =
      compress("w.weft",
               {"--rank", "3", "--weights", "views=" + path("v.npy") + ",texels=" + path("t.npy")});
  ASSERT_EQ(weighted.status, 0) << weighted.err;
  const ProcessResult selected =
      compress("s.weft", {"--rank", "3", "--views", "1,2,4", "--region", "3,2,5x7"});
  ASSERT_EQ(selected.status, 0) << selected.err;
  EXPECT_EQ(tensors("w.weft"), tensors("s.weft"));
  EXPECT_EQ(json::parse(weighted.out).at("selection"), json::parse(selected.out).at("selection"));
}

TEST_F(WeightsProcess, TheSameBytesWhateverTheMemory) {
  std::vector<float> texels(12 * 10);
  for (std::size_t p = 0; p < texels.size(); ++p) texels[p] = 1 + static_cast<float>(p % 7);
  write_weights("t.npy", {12, 10}, texels);
  for (const char* memory : {"2GiB", "100MiB"}) {
    ASSERT_EQ(compress(std::string(memory) + ".weft", {"--rank", "3", "--memory", memory,
                                                       "--weights", "cos,texels=" + path("t.npy")})
                  .status,
              0);
  }
  EXPECT_EQ(tensors("2GiB.weft"), tensors("100MiB.weft"));
}

TEST_F(WeightsProcess, VerifyAsksForFiles) {
  write_weights("l.npy", {6}, {1, 2, 3, 4, 5, 6});
  write_weights("other.npy", {6}, {1, 2, 3, 4, 5, 7});
  ASSERT_EQ(compress("m.weft", {"--rank", "3", "--weights", "lights=" + path("l.npy")}).status, 0);
  std::vector<std::string> verify{"verify", path("m.weft"), "--against", path("cloth.safetensors"),
                                  "--json"};
  const ProcessResult without = run_weft(verify);
  ASSERT_EQ(without.status, 0) << without.err;
  EXPECT_FALSE(json::parse(without.out).contains("weighted_errors"));
  verify.insert(verify.end(), {"--weights", "lights=" + path("l.npy")});
  const ProcessResult with = run_weft(verify);
  ASSERT_EQ(with.status, 0) << with.err;
  EXPECT_EQ(json::parse(with.out).at("weighted_errors").size(), 3U);
  // others are measured with, but nothing was recorded of them
  verify.back() = "lights=" + path("other.npy");
  const ProcessResult other = run_weft(verify);
  ASSERT_EQ(other.status, 0) << other.err;
  EXPECT_EQ(json::parse(other.out).at("weighted_errors").size(), 2U);
}

// Each fit is the better one by its own measure, of models of any making.
TEST_F(WeightsProcess, PlainModelsAreMeasuredToo) {
  ASSERT_EQ(compress("plain.weft", {"--rank", "3", "--views", "0-3"}).status, 0);
  const ProcessResult made = compress("m.weft", {"--rank", "3", "--weights", "cos"});
  const ProcessResult plain = run_weft({"verify", path("plain.weft"), "--against",
                                        path("cloth.safetensors"), "--weights", "cos", "--json"});
  ASSERT_EQ(plain.status, 0) << plain.err;
  const json rows = json::parse(plain.out).at("weighted_errors");
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_GT(rows.at(0).at("rmse").get<double>(),
            json::parse(made.out).at("weighted_errors").at("rmse").get<double>());
}

TEST_F(WeightsProcess, BadUsage) {
  write_weights("short.npy", {4}, {1, 1, 1, 1});
  write_weights("negative.npy", {5}, {1, 1, -2, 1, 1});
  std::vector<float> texels(12 * 10, 1.0f);
  texels[15] = 0;
  write_weights("hole.npy", {12, 10}, texels);
  texels[15] = 3;
  write_weights("bump.npy", {12, 10}, texels);
  struct Case {
    std::vector<std::string> options;
    std::vector<std::string> named;
  };
  for (const Case& bad : std::vector<Case>{
           {{"--weights", "sine"}, {"--weights", "sine"}},
           {{"--weights", "views=" + path("absent.npy")}, {"absent.npy"}},
           {{"--weights", "views=" + path("short.npy")}, {"short.npy", "(4,)", "(5,)"}},
           {{"--weights", "views=" + path("negative.npy")}, {"negative.npy", "-2", "view 2"}},
           {{"--weights", "texels=" + path("hole.npy")}, {"row 1", "column 5"}},
           {{"--codec", "tt", "--rank", "2", "--weights", "texels=" + path("bump.npy")},
            {"--weights", "tt"}}}) {
    const ProcessResult result = compress("bad.weft", bad.options);
    EXPECT_EQ(result.status, 2) << bad.options[1];
    for (const std::string& part : bad.named) {
      EXPECT_NE(result.err.find(part), std::string::npos) << result.err << " names no " << part;
    }
  }
  ASSERT_EQ(compress("plain.weft", {"--rank", "3"}).status, 0);
  EXPECT_EQ(run_weft({"verify", path("plain.weft"), "--weights", "cos"}).status, 2);
}

}  // namespace
}  // namespace weft::test
