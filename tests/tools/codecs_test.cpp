// Every codec of the table as processes: compress, verify, info, decompress and sheet, on the
// device and by the reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class CodecProcess : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    const auto source = random_source({5, 6, 12, 10, 3}, DType::f16, 3);
    const auto sink = create_raw_btf(raw(), source->info());
    sink->write(0, source->info().shape.images(), source->bytes());
    sink->finish();
  }
  std::string raw() const { return folder_ / "cloth.safetensors"; }
  std::string path(const std::string& name) const { return folder_ / name; }
  // The option that says how large a model is, where 4 is a legal value of it.
  static std::string size() { return GetParam() == "vq" ? "--threshold" : "--rank"; }

  TemporaryFolder folder_;
};

std::vector<std::string> codec_names() {
  std::vector<std::string> names;
  for (const Codec* codec : codecs()) names.emplace_back(codec->name());
  return names;
}

INSTANTIATE_TEST_SUITE_P(Table, CodecProcess, testing::ValuesIn(codec_names()),
                         [](const auto& info) {
                           std::string name = info.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(CodecProcess, CompressesVerifiesAndDecompresses) {
  for (const std::string storage : {"f16", "f32"}) {
    const std::string model = path(storage + ".weft");
    const ProcessResult compressed = run_weft({"compress", raw(), "--codec", GetParam(), size(),
                                               "4", "--storage", storage, "--json", "-o", model});
    ASSERT_EQ(compressed.status, 0) << compressed.err;
    EXPECT_EQ(json::parse(compressed.out).at("codec"), GetParam());
    const ProcessResult verified = run_weft({"verify", model, "--against", raw(), "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    EXPECT_EQ(json::parse(verified.out).at("device_against_reference").at("agree"), true);
    EXPECT_EQ(json::parse(verified.out).at("as_recorded"), true);
    const ProcessResult info = run_weft({"info", model, "--json"});
    ASSERT_EQ(info.status, 0) << info.err;
    EXPECT_NE(info.out.find("\"" + GetParam() + "\""), std::string::npos) << info.out;
    for (const std::string device : {"auto", "reference"}) {
      const ProcessResult images =
          run_weft({"decompress", model, "--views", "4,1", "--region", "2,1,5x6", "--device",
                    device, "-o", path(storage + device + ".npy")});
      EXPECT_EQ(images.status, 0) << images.err;
    }
    EXPECT_EQ(run_weft({"sheet", raw(), model, "-o", path(storage + ".png")}).status, 0);
  }
}

TEST_P(CodecProcess, ReferenceNeedsNoDevice) {
  const ProcessResult result = run_weft({"compress", raw(), "--codec", GetParam(), size(), "4",
                                         "--device", "reference", "-o", path("r.weft")},
                                        {{"OCL_ICD_VENDORS", path("no-drivers")}});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(run_weft({"verify", path("r.weft"), "--against", raw()}).status, 0);
}

TEST_P(CodecProcess, ModelsAreTheSameTwice) {
  for (const std::string name : {"a.weft", "b.weft"}) {
    ASSERT_EQ(run_weft({"compress", raw(), "--codec", GetParam(), size(), "4", "--seed", "7",
                        "--memory", name == "a.weft" ? "1GiB" : "100MiB", "-o", path(name)})
                  .status,
              0);
  }
  const auto a = read_model(path("a.weft"));
  const auto b = read_model(path("b.weft"));
  ASSERT_EQ(a->tensors().size(), b->tensors().size());
  for (std::size_t i = 0; i < a->tensors().size(); ++i) {
    const ModelTensor x = a->tensors()[i];
    const ModelTensor y = b->tensors()[i];
    EXPECT_TRUE(std::equal(x.values.begin(), x.values.end(), y.values.begin(), y.values.end()))
        << x.name;
  }
}

TEST(CodecOptions, BelongToTheirCodec) {
  const TemporaryFolder folder;
  const ProcessResult result = run_weft({"compress", folder / "none.safetensors", "--codec", "pca",
                                         "--clusters", "4", "-o", folder / "m.weft"});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("--clusters 4: not a parameter of codec pca"), std::string::npos)
      << result.err;
  const ProcessResult help = run_weft({"compress", "--help"});
  EXPECT_NE(help.out.find("--clusters"), std::string::npos);
  EXPECT_NE(help.out.find("lpca: number of components k per cluster [8]"), std::string::npos)
      << help.out;
}

}  // namespace
}  // namespace weft::test
