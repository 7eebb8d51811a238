// weft compress --svd, --tolerance and --energy as processes: what is chosen, what is met, and the
// memory that inputs larger than it take.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

constexpr std::size_t mebibyte = std::size_t{1} << 20;

// A raw BTF whose values change smoothly over texels and images, with a little noise.
void write_smooth(const std::string& path, const BtfShape& shape, DType dtype) {
  const auto sink = create_raw_btf(path, make_info(shape, dtype));
  Random random(7);
  std::vector<double> image(shape.image_values());
  for (std::size_t i = 0; i < shape.images(); ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(shape.images());
    for (std::size_t at = 0; at < image.size(); ++at) {
      const double p = static_cast<double>(at) / static_cast<double>(image.size());
      image[at] = 0.5 + 0.2 * std::sin(9 * t + 40 * p) + 0.1 * std::cos(70 * t * p) +
                  0.01 * random.uniform();
    }
    sink->write(i, 1, encode_values(image, dtype));
  }
  sink->finish();
}

// The same for large ones: sixteen images in turn, so that there is little to compute.
void write_repeating(const std::string& path, const BtfShape& shape) {
  const auto sink = create_raw_btf(path, make_info(shape, DType::f32));
  std::vector<std::vector<std::byte>> images;
  for (std::uint64_t i = 0; i < 16; ++i) {
    images.push_back(encode_values(random_values(shape.image_values(), i), DType::f32));
  }
  for (std::size_t i = 0; i < shape.images(); ++i) sink->write(i, 1, images[i * i % 16]);
  sink->finish();
}

class Truncation : public testing::Test {
 protected:
  std::string raw() const { return folder_ / "cloth.safetensors"; }
  std::string path(const std::string& name) const { return folder_ / name; }

  TemporaryFolder folder_;
};

TEST_F(Truncation, EveryWayAndGoalGivesAModelThatVerifies) {
  write_smooth(raw(), {5, 6, 12, 10, 3}, DType::f16);
  for (const char* device : {"auto", "reference"}) {
    for (const char* method : {"auto", "gram", "randomized", "qr"}) {
      const ProcessResult result =
          run_weft({"compress", raw(), "--svd", method, "--tolerance", "0.02", "--arithmetic",
                    "f64", "--storage", "f32", "--device", device, "--json", "-o", path("m.weft")});
      ASSERT_EQ(result.status, 0) << result.err;
      const json report = json::parse(result.out);
      EXPECT_LE(report.at("errors").at("relative").get<double>(), 0.02 * 1.001);
      const json info = json::parse(run_weft({"info", path("m.weft"), "--json"}).out)
                            .at("files")
                            .at(0)
                            .at("parameters");
      EXPECT_EQ(info.at("tolerance"), 0.02);
      EXPECT_GT(info.at("kept"), 0);
      if (std::string(method) != "auto") {
        EXPECT_EQ(info.at("svd"), method);
      } else {
        EXPECT_NE(info.at("svd"), "auto");
        EXPECT_FALSE(info.at("reason").get<std::string>().empty());
      }
      const ProcessResult verify = run_weft({"verify", path("m.weft"), "--against", raw()});
      EXPECT_EQ(verify.status, 0) << verify.err;
    }
  }
}

TEST_F(Truncation, UnmetGoalsAreStatusOneAndLeaveNothing) {
  write_smooth(raw(), {5, 6, 12, 10, 3}, DType::f16);
  for (const char* method : {"auto", "gram", "randomized", "qr"}) {
    const ProcessResult result = run_weft({"compress", raw(), "--svd", method, "--rank", "2",
                                           "--tolerance", "1e-3", "-o", path("m.weft")});
    EXPECT_EQ(result.status, 1) << result.err;
    EXPECT_NE(result.err.find("--tolerance 0.001"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("--rank"), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("m.weft")));
  }
}

// Private memory that is resident, without files: what --memory and the program itself take.
std::size_t resident_private_bytes(pid_t id) {
  std::ifstream status("/proc/" + std::to_string(id) + "/status");
  std::string line;
  while (std::getline(status, line)) {
    if (line.rfind("RssAnon:", 0) == 0) return std::stoull(line.substr(8)) * 1024;
  }
  return 0;
}

// Half a gibibyte of F32, which is eight times --memory, streamed by runs of images and by blocks
// of texels.
TEST_F(Truncation, InputsBeyondTheMemoryStayWithinIt) {
  struct Case {
    BtfShape shape;
    std::vector<const char*> methods;
  };
  const Case cases[] = {{{74, 74, 64, 128, 3}, {"randomized"}},
                        {{10, 12, 610, 610, 3}, {"gram", "qr"}}};
  for (const Case& c : cases) {
    write_repeating(raw(), c.shape);
    const std::size_t memory = c.shape.values() * sizeof(float) / 8;
    for (const char* method : c.methods) {
      Process process(weft_command({"compress", raw(), "--svd", method, "--rank", "2", "--memory",
                                    std::to_string(memory), "-o", path("m.weft")}));
      std::size_t peak = 0;
      while (process.running()) {
        peak = std::max(peak, resident_private_bytes(process.id()));
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
      const ProcessResult result = process.wait();
      EXPECT_EQ(result.status, 0) << method << ": " << result.err;
      EXPECT_GT(peak, 0U);
      // The address sanitizer keeps freed memory, and shadows of all.
#ifndef __SANITIZE_ADDRESS__
      EXPECT_LE(peak, memory + 256 * mebibyte) << method;
#endif
    }
  }
}

}  // namespace
}  // namespace weft::test
