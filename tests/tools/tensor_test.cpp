// Tucker models as processes: goals, merged modes, expansion, reduction, bad usage.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/example_model.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

class TuckerProcess : public testing::Test {
 protected:
  void SetUp() override {
    const auto source = random_source({5, 6, 12, 10, 3}, DType::f16, 3);
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
  void expect_bad(const std::vector<std::string>& arguments, const std::string& text) const {
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2);
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
  }

  TemporaryFolder folder_;
};

TEST_F(TuckerProcess, TensorTexturesAreReducedAndExpanded) {
  const json made = run({"compress", raw(), "--codec", "tucker", "--merge", "yxc", "--ranks",
                         "v=4,l=5", "-o", path("m.weft")});
  EXPECT_EQ(made.at("parameters").at("ranks").at("l"), 5);
  EXPECT_EQ(made.at("parameters").at("ranks").at("yxc"), 360);
  const json less = run({"reduce", path("m.weft"), "--ranks", "l=2", "-o", path("less.weft")});
  EXPECT_EQ(less.at("ranks").at("l"), 2);
  EXPECT_EQ(less.at("ranks").at("v"), 4);
  run({"verify", path("less.weft"), "--against", raw()});
  run({"verify", path("less.weft"), "--expand", "v", "--against", raw()});
  run({"compress", raw(), "--codec", "tucker", "--ranks", "y=5,x=6,v=3", "-o", path("n.weft")});
  run({"verify", path("n.weft"), "--expand", "y,x"});
  run({"decompress", path("n.weft"), "--expand", "y,x", "-o", path("n.npy")});
  run({"decompress", path("n.weft"), "-o", path("plain.npy")});
  EXPECT_EQ(std::filesystem::file_size(path("n.npy")),
            std::filesystem::file_size(path("plain.npy")));
}

TEST_F(TuckerProcess, GoalsAreMet) {
  const json relative = run({"compress", raw(), "--codec", "tucker", "--target", "rel=0.2",
                             "--method", "hosvd", "-o", path("r.weft")});
  EXPECT_LE(relative.at("errors").at("relative").get<double>(), 0.2);
  const json size =
      run({"compress", raw(), "--codec", "tucker", "--target", "size=8KiB", "-o", path("s.weft")});
  EXPECT_LE(std::filesystem::file_size(path("s.weft")), 8192U);
  EXPECT_EQ(size.at("parameters").at("goal"), "size=8KiB");
  EXPECT_EQ(run_weft({"compress", raw(), "--codec", "tucker", "--target", "size=1KiB", "-o",
                      path("x.weft")})
                .status,
            1);
  EXPECT_FALSE(std::filesystem::exists(path("x.weft")));
}

TEST_F(TuckerProcess, BadUsageIsNamed) {
  expect_bad({"compress", raw(), "--codec", "tucker", "--ranks", "v=9", "-o", path("x.weft")},
             "--ranks v=9");
  expect_bad({"compress", raw(), "--codec", "tucker", "--merge", "vx", "-o", path("x.weft")},
             "--merge vx");
  write_pca_model(path("pca.weft"), {2, 2, 3, 3, 3});
  expect_bad({"reduce", path("pca.weft"), "--ranks", "v=1", "-o", path("x.weft")}, "codec pca");
  expect_bad({"decompress", path("pca.weft"), "--expand", "y", "-o", path("x.npy")}, "--expand y");
  run({"compress", raw(), "--codec", "tucker", "--ranks", "v=4", "-o", path("m.weft")});
  expect_bad({"reduce", path("m.weft"), "--ranks", "v=5", "-o", path("x.weft")}, "--ranks v=5");
  expect_bad({"reduce", path("m.weft"), "--ranks", "l=2", "-o", path("x.weft")}, "mode l is whole");
  expect_bad({"reduce", path("m.weft"), "--ranks", "v=2", "-o", path("x.npy")}, ".weft");
  expect_bad({"reduce", path("m.weft"), "-o", path("x.weft")}, "--ranks");
  EXPECT_EQ(run_weft({"reduce", "--help"}).status, 0);
}

}  // namespace
}  // namespace weft::test
