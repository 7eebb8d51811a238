// weft compress, decompress and verify as processes: the main job, its parts, and bad input.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/example_model.hpp"
#include "tools/weft_process.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const BtfShape shape{5, 6, 12, 10, 3};

void write_raw(const fs::path& path, TileSource& source) {
  std::vector<std::byte> bytes(source.info().bytes());
  source.read(0, source.info().shape.images(), bytes);
  const auto sink = create_raw_btf(path, source.info());
  sink->write(0, source.info().shape.images(), bytes);
  sink->finish();
}

std::vector<double> raw_values(const fs::path& path) {
  const auto source = open_raw_btf(path);
  std::vector<std::byte> bytes(source->info().bytes());
  source->read(0, source->info().shape.images(), bytes);
  return decode_values(bytes, source->info().dtype);
}

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A folder with a raw BTF and its model.
class Compress : public testing::Test {
 protected:
  void SetUp() override {
    write_raw(raw(), *random_source(shape, DType::f16, 3));
    compress_result_ =
        run_weft({"compress", raw(), "--rank", "8", "--storage", "f32", "--json", "-o", model()});
    ASSERT_EQ(compress_result_.status, 0) << compress_result_.err;
  }

  std::string raw() const { return folder_ / "cloth.safetensors"; }
  std::string model() const { return folder_ / "cloth.weft"; }
  std::string path(const std::string& name) const { return folder_ / name; }

  TemporaryFolder folder_;
  ProcessResult compress_result_;
};

TEST_F(Compress, ReportsWhatTheFileHolds) {
  const json report = json::parse(compress_result_.out);
  EXPECT_EQ(report.at("codec"), "pca");
  EXPECT_EQ(report.at("parameters").at("rank"), 8);
  EXPECT_EQ(report.at("raw_size"), shape.values() * 2);
  EXPECT_EQ(report.at("file_size"), fs::file_size(model()));
  EXPECT_NEAR(report.at("ratio").get<double>(),
              static_cast<double>(shape.values() * 2) / static_cast<double>(fs::file_size(model())),
              1e-9);
  // The figures are those of the model file, and those of a comparison made here.
  const auto file = read_model(model());
  ASSERT_TRUE(file->info.errors.has_value());
  EXPECT_EQ(report.at("errors").at("rmse"), file->info.errors->rmse);
  const std::vector<double> values = raw_values(raw());
  double squares = 0;
  std::vector<double> texel(3);
  for (std::size_t i = 0; i < values.size(); i += 3) {
    const std::size_t image = i / shape.image_values();
    const std::size_t p = i / 3 % shape.texels();
    file->decode_texel(image / shape.lights, image % shape.lights, p / shape.width, p % shape.width,
                       texel);
    for (std::size_t c = 0; c < 3; ++c) squares += std::pow(values[i + c] - texel[c], 2);
  }
  EXPECT_NEAR(report.at("errors").at("rmse").get<double>(),
              std::sqrt(squares / static_cast<double>(values.size())), 1e-6);
}

TEST_F(Compress, SaysItsMemoryPlanBeforeTheWork) {
  EXPECT_NE(compress_result_.err.find("memory: "), std::string::npos) << compress_result_.err;
  const ProcessResult quiet = run_weft({"compress", raw(), "--quiet", "-o", path("q.weft")});
  EXPECT_EQ(quiet.status, 0);
  EXPECT_EQ(quiet.out + quiet.err, "");
}

TEST_F(Compress, TheSameBytesTwice) {
  const ProcessResult again = run_weft({"compress", raw(), "--rank", "8", "--storage", "f32",
                                        "--memory", "100MiB", "--quiet", "-o", path("b.weft")});
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(read_file(model()), read_file(path("b.weft")));
}

TEST_F(Compress, ReferenceNeedsNoDevice) {
  const ProcessResult result = run_weft({"compress", raw(), "--rank", "8", "--storage", "f32",
                                         "--device", "reference", "--json", "-o", path("r.weft")},
                                        {{"OCL_ICD_VENDORS", path("no-drivers")}});
  ASSERT_EQ(result.status, 0) << result.err;
  const double device = json::parse(compress_result_.out).at("errors").at("rmse");
  EXPECT_NEAR(json::parse(result.out).at("errors").at("rmse").get<double>(), device, 0.01 * device);
  const ProcessResult images =
      run_weft({"decompress", path("r.weft"), "--device", "reference", "-o", path("r.npy")},
               {{"OCL_ICD_VENDORS", path("no-drivers")}});
  EXPECT_EQ(images.status, 0) << images.err;
}

TEST_F(Compress, NoDeviceIsStatusThree) {
  const std::map<std::string, std::string> none{{"OCL_ICD_VENDORS", path("no-drivers")}};
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"compress", raw(), "-o", path("n.weft")},
        std::vector<std::string>{"decompress", model(), "-o", path("n.npy")},
        std::vector<std::string>{"verify", model()}}) {
    const ProcessResult result = run_weft(command, none);
    EXPECT_EQ(result.status, 3) << command.front();
    EXPECT_NE(result.err.find("apt-get install pocl-opencl-icd"), std::string::npos) << result.err;
  }
  EXPECT_FALSE(fs::exists(path("n.weft")));
  EXPECT_FALSE(fs::exists(path("n.npy")));
}

TEST_F(Compress, FitsTheSelectionOnly) {
  const ProcessResult result =
      run_weft({"compress", raw(), "--rank", "4", "--views", "1-3", "--lights", "0,5", "--region",
                "2,1,8x6", "--level", "1", "--json", "-o", path("part.weft")});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(json::parse(result.out).at("shape"), json({3, 2, 3, 4, 3}));
  const ProcessResult verify =
      run_weft({"verify", path("part.weft"), "--against", raw(), "--json"});
  EXPECT_EQ(verify.status, 0) << verify.err;
  EXPECT_EQ(json::parse(verify.out).at("as_recorded"), true);
}

TEST_F(Compress, ImagesThatAreNotNeighboursAreSelected) {
  const ProcessResult result = run_weft({"compress", raw(), "--rank", "4", "--views", "4,0",
                                         "--lights", "5,1,3", "-o", path("part.weft")});
  ASSERT_EQ(result.status, 0) << result.err;
  const ProcessResult verify = run_weft({"verify", path("part.weft"), "--against", raw()});
  EXPECT_EQ(verify.status, 0) << verify.err;
}

TEST_F(Compress, QuantisedModelsServeEverySubcommand) {
  std::size_t half = 0;
  for (const std::string storage : {"f16", "q=10", "q=6", "auto", "auto=0.05"}) {
    SCOPED_TRACE(storage);
    const std::string file = path("q.weft");
    const ProcessResult made =
        run_weft({"compress", raw(), "--rank", "8", "--storage", storage, "--json", "-o", file});
    ASSERT_EQ(made.status, 0) << made.err;
    const json report = json::parse(made.out);
    const std::size_t size = fs::file_size(file);
    if (storage == "f16") half = size;
    EXPECT_LE(size, half);
    EXPECT_EQ(report.at("file_size"), size);
    EXPECT_TRUE(storage.front() != 'q' || report.at("storage") == storage);
    // the file decodes to what was measured, on the device and by the reference
    const ProcessResult verify = run_weft({"verify", file, "--against", raw(), "--json"});
    EXPECT_EQ(verify.status, 0) << verify.err;
    EXPECT_EQ(json::parse(verify.out).at("as_recorded"), true);
    const ProcessResult info = run_weft({"info", file, "--json"});
    EXPECT_EQ(info.status, 0) << info.err;
    EXPECT_EQ(json::parse(info.out).at("files").at(0).at("storage"), report.at("storage"));
    // the same bytes under another bound on the memory
    const std::string again = path("again.weft");
    EXPECT_EQ(run_weft({"compress", raw(), "--rank", "8", "--storage", storage, "--memory", "90MiB",
                        "--quiet", "-o", again})
                  .status,
              0);
    EXPECT_EQ(read_file(file), read_file(again));
  }
  const std::string q = path("q.weft");
  EXPECT_EQ(run_weft({"decompress", q, "--views", "1", "-o", path("d.npy")}).status, 0);
  EXPECT_EQ(run_weft({"render", q, "--size", "16", "-o", path("ball.png")}).status, 0);
  EXPECT_EQ(run_weft({"bench", "--model", q, "--lookups", "1000", "--repeat", "1"}).status, 0);
}

TEST_F(Compress, BadRequestsAreStatusTwoAndLeaveNothing) {
  const std::string out = path("bad.weft");
  const std::pair<std::vector<std::string>, std::string> cases[] = {
      {{raw(), "--rank", "0", "-o", out}, "--rank 0"},
      {{raw(), "--rank", "many", "-o", out}, "--rank many"},
      {{raw(), "--codec", "zip", "-o", out}, "codec 'zip'"},
      {{raw(), "--storage", "f8", "-o", out}, "--storage f8"},
      {{raw(), "--storage", "q=3", "-o", out}, "--storage q=3"},
      {{raw(), "--storage", "q=17", "-o", out}, "--storage q=17"},
      {{raw(), "--storage", "auto=0", "-o", out}, "--storage auto=0"},
      {{raw(), "--views", "9", "-o", out}, "--views"},
      {{raw(), "--region", "0,0,99x1", "-o", out}, "region"},
      {{raw(), "--memory", "10KiB", "-o", out}, "--memory 10240"},
      {{raw(), "--memory", "lots", "-o", out}, "lots"},
      {{raw(), "--seed", "18446744073709551616", "-o", out}, "--seed 18446744073709551616"},
      {{raw(), "--seed", "1e3", "-o", out}, "--seed 1e3"},
      {{raw(), "--device", "abacus", "-o", out}, "abacus"},
      {{raw(), "-o", path("bad.txt")}, "bad.txt"},
      {{raw(), "-o", path("nowhere/bad.weft")}, "nowhere"},
      {{path("missing.safetensors"), "-o", out}, "missing.safetensors"},
      {{model(), "-o", out}, "cloth.weft"},
      {{raw()}, "--output"},
  };
  for (const auto& [arguments, named] : cases) {
    std::vector<std::string> command{"compress"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const ProcessResult result = run_weft(command);
    EXPECT_EQ(result.status, 2) << named << ": " << result.err;
    EXPECT_NE(result.err.find(named), std::string::npos) << named << ": " << result.err;
    EXPECT_EQ(result.out, "");
  }
  // only the raw file and the model of the set-up
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 2);
}

TEST_F(Compress, NaNIsRefusedByPlaceOrReadAsZero) {
  auto values = random_values(shape.values(), 3);
  values[4] = std::nan("");
  write_raw(path("nan.safetensors"), *source_of(shape, DType::f32, values));
  const ProcessResult refused =
      run_weft({"compress", path("nan.safetensors"), "-o", path("n.weft")});
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.err.find("view 0, light 0, row 0, column 1, channel 1"), std::string::npos)
      << refused.err;
  EXPECT_FALSE(fs::exists(path("n.weft")));
  const ProcessResult zero =
      run_weft({"compress", path("nan.safetensors"), "--nan", "zero", "-o", path("n.weft")});
  EXPECT_EQ(zero.status, 0) << zero.err;
  EXPECT_EQ(run_weft({"verify", path("n.weft"), "--against", path("nan.safetensors")}).status, 2);
  EXPECT_EQ(
      run_weft({"verify", path("n.weft"), "--nan", "zero", "--against", path("nan.safetensors")})
          .status,
      0);
}

// A mip level averages; what is read as 0 is 0 before, and spoils no neighbour.
TEST_F(Compress, NaNIsZeroBeforeItIsAveraged) {
  std::vector<double> values(shape.values(), 0.5);
  values[0] = std::nan("");
  write_raw(path("nan.safetensors"), *source_of(shape, DType::f32, values));
  ASSERT_EQ(run_weft({"compress", path("nan.safetensors"), "--nan", "zero", "--level", "1",
                      "--rank", "1", "--storage", "f32", "-o", path("n.weft")})
                .status,
            0);
  ASSERT_EQ(run_weft({"decompress", path("n.weft"), "-o", path("n.safetensors")}).status, 0);
  EXPECT_NEAR(raw_values(path("n.safetensors"))[0], 0.75 * 0.5, 1e-6);
}

TEST_F(Compress, SubnormalDataVerify) {
  const auto source = source_of(shape, DType::f32, random_values(shape.values(), 3, 0, 1e-41));
  write_raw(path("tiny.safetensors"), *source);
  ASSERT_EQ(run_weft({"compress", path("tiny.safetensors"), "--rank", "3", "--storage", "f32", "-o",
                      path("tiny.weft")})
                .status,
            0);
  const ProcessResult verify = run_weft({"verify", path("tiny.weft")});
  EXPECT_EQ(verify.status, 0) << verify.err;
}

TEST_F(Compress, ValuesBeyondTheRangeAreRefused) {
  const auto source = source_of(shape, DType::f32, random_values(shape.values(), 3, 1e36, 2e36));
  write_raw(path("huge.safetensors"), *source);
  const ProcessResult result =
      run_weft({"compress", path("huge.safetensors"), "-o", path("huge.weft")});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("first beyond 2^100 (1.27e30) at view 0"), std::string::npos)
      << result.err;
}

TEST_F(Compress, MemoryBoundsEveryWayOfDecompressing) {
  for (const std::vector<std::string>& way :
       {std::vector<std::string>{}, std::vector<std::string>{"--device", "reference"},
        std::vector<std::string>{"--level", "1"}}) {
    std::vector<std::string> command{"decompress", model(), "--memory",
                                     "1KiB",       "-o",    path("x.npy")};
    command.insert(command.end(), way.begin(), way.end());
    const ProcessResult result = run_weft(command);
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find("--memory 1024"), std::string::npos) << result.err;
    EXPECT_FALSE(fs::exists(path("x.npy")));
  }
}

TEST_F(Compress, HelpHasExamples) {
  for (const char* command : {"compress", "decompress", "verify", "bench"}) {
    const ProcessResult help = run_weft({command, "--help"});
    EXPECT_EQ(help.status, 0);
    EXPECT_NE(help.out.find("Examples:"), std::string::npos) << command;
    const ProcessResult missing = run_weft({command, "--no-such-option"});
    EXPECT_EQ(missing.status, 2) << command;
  }
}

TEST_F(Compress, DecompressesToRawNpyAndImages) {
  const ProcessResult raw_result =
      run_weft({"decompress", model(), "--dtype", "f32", "-o", path("d.safetensors"), "--json"});
  ASSERT_EQ(raw_result.status, 0) << raw_result.err;
  EXPECT_GT(json::parse(raw_result.out).at("image_rate").get<double>(), 0);
  const std::vector<double> decoded = raw_values(path("d.safetensors"));
  // what the model says of every texel
  const auto file = read_model(model());
  const double tolerance = find_codec("pca").decode_tolerance(*file);
  std::vector<double> texel(3);
  for (std::size_t i = 0; i < decoded.size(); i += 3) {
    const std::size_t image = i / shape.image_values();
    const std::size_t p = i / 3 % shape.texels();
    file->decode_texel(image / shape.lights, image % shape.lights, p / shape.width, p % shape.width,
                       texel);
    ASSERT_TRUE(all_near(std::span(decoded).subspan(i, 3), texel, tolerance)) << i;
  }
  // images come back as the same values, rounded to half
  for (const char* compression : {"none", "zip", "piz"}) {
    const std::string folder = path(compression);
    ASSERT_EQ(run_weft({"decompress", model(), "--compression", compression, "-o", folder}).status,
              0);
    ASSERT_EQ(run_weft({"import", folder, "-o", folder + ".safetensors"}).status, 0);
    EXPECT_TRUE(all_near(raw_values(folder + ".safetensors"), decoded, [&](std::size_t i) {
      return half_roundoff * std::abs(decoded[i]) + 0x1p-25 + tolerance;
    })) << compression;
  }
  // and through the reference
  ASSERT_EQ(run_weft({"decompress", model(), "--device", "reference", "--dtype", "f32", "-o",
                      path("e.safetensors")})
                .status,
            0);
  EXPECT_TRUE(all_near(raw_values(path("e.safetensors")), decoded, tolerance));
}

TEST_F(Compress, DecompressesSelections) {
  ASSERT_EQ(
      run_weft({"decompress", model(), "--dtype", "f32", "-o", path("whole.safetensors")}).status,
      0);
  const std::vector<double> whole = raw_values(path("whole.safetensors"));
  ASSERT_EQ(run_weft({"decompress", model(), "--dtype", "f32", "--views", "4,2", "--lights", "1",
                      "--region", "3,2,4x5", "--channels", "1", "-o", path("part.safetensors")})
                .status,
            0);
  const std::vector<double> part = raw_values(path("part.safetensors"));
  std::vector<double> expected;
  for (const std::size_t v : {4, 2}) {
    for (std::size_t y = 2; y < 7; ++y) {
      for (std::size_t x = 3; x < 7; ++x) {
        expected.push_back(whole[(((v * 6 + 1) * 12 + y) * 10 + x) * 3 + 1]);
      }
    }
  }
  EXPECT_TRUE(all_near(part, expected, 1e-6));
  // a mip level averages 2 x 2 texels
  ASSERT_EQ(run_weft({"decompress", model(), "--dtype", "f32", "--level", "1", "-o",
                      path("level.safetensors")})
                .status,
            0);
  const std::vector<double> level = raw_values(path("level.safetensors"));
  ASSERT_EQ(level.size(), whole.size() / 4);
  EXPECT_NEAR(level[0], (whole[0] + whole[3] + whole[30] + whole[33]) / 4, 1e-6);
}

TEST_F(Compress, DecompressRefusesBadRequests) {
  fs::create_directory(path("full"));
  std::ofstream(path("full/file")) << "x";
  const std::pair<std::vector<std::string>, std::string> cases[] = {
      {{model(), "-o", path("x.weft")}, "x.weft"},
      {{model(), "-o", path("full")}, "full"},
      {{model(), "--format", "gif", "-o", path("x")}, "--format"},
      {{model(), "--dtype", "u8", "-o", path("x")}, "--dtype"},
      {{model(), "--format", "png", "--dtype", "f32", "-o", path("x")}, "--dtype"},
      {{model(), "--views", "77", "-o", path("x")}, "--views"},
      {{raw(), "-o", path("x")}, "cloth.safetensors"},
      {{path("missing.weft"), "-o", path("x")}, "missing.weft"},
  };
  for (const auto& [arguments, named] : cases) {
    std::vector<std::string> command{"decompress"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const ProcessResult result = run_weft(command);
    EXPECT_EQ(result.status, 2) << named << ": " << result.err;
    EXPECT_NE(result.err.find(named), std::string::npos) << named << ": " << result.err;
  }
  EXPECT_FALSE(fs::exists(path("x")));
  EXPECT_EQ(read_file(path("full/file")), "x");
}

TEST_F(Compress, VerifyComparesAllThree) {
  const ProcessResult result = run_weft({"verify", model(), "--against", raw(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json report = json::parse(result.out);
  const json& check = report.at("device_against_reference");
  EXPECT_EQ(check.at("agree"), true);
  EXPECT_GT(check.at("tolerance").get<double>(), 0);
  EXPECT_LE(check.at("largest_in_tolerances").get<double>(), 1);
  EXPECT_GE(check.at("largest_difference").get<double>(), check.at("rms_difference").get<double>());
  ASSERT_EQ(report.at("errors").size(), 3U);
  EXPECT_EQ(report.at("errors").at(0).at("rmse"), report.at("errors").at(2).at("rmse"));
  EXPECT_NEAR(report.at("errors").at(1).at("rmse").get<double>(),
              report.at("errors").at(0).at("rmse").get<double>(), 1e-7);
}

// A NaN of the device counts, whatever is decoded behind it.
TEST_F(Compress, VerifyFailsWhereTheDeviceHasNoNumber) {
  const ProcessResult result =
      run_weft({"verify", write_overflowing_model(path("overflow.weft")), "--tolerance", "1e6"});
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.err.find("differ by nan"), std::string::npos) << result.err;
}

TEST_F(Compress, VerifyFailsBeyondItsTolerance) {
  const ProcessResult strict = run_weft({"verify", model(), "--tolerance", "1e-6"});
  EXPECT_EQ(strict.status, 1);
  EXPECT_NE(strict.err.find("differ by"), std::string::npos) << strict.err;
  // another raw BTF of the same shape
  write_raw(path("other.safetensors"), *random_source(shape, DType::f16, 4));
  const ProcessResult other = run_weft({"verify", model(), "--against", path("other.safetensors")});
  EXPECT_EQ(other.status, 1);
  // and one of another shape
  write_raw(path("small.safetensors"), *random_source({5, 6, 12, 9, 3}, DType::f16, 4));
  const ProcessResult small = run_weft({"verify", model(), "--against", path("small.safetensors")});
  EXPECT_EQ(small.status, 2);
  EXPECT_NE(small.err.find("[5,6,12,9,3]"), std::string::npos) << small.err;
}

TEST_F(Compress, ADamagedModelIsNamed) {
  std::string bytes = read_file(model());
  const std::size_t at = bytes.size() / 2;  // in the factors: still a finite number
  bytes[at] = static_cast<char>(bytes[at] ^ 1);
  std::ofstream(path("damaged.weft"), std::ios::binary) << bytes;
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"verify", path("damaged.weft")},
        std::vector<std::string>{"decompress", path("damaged.weft"), "-o", path("x")}}) {
    const ProcessResult result = run_weft(command);
    EXPECT_EQ(result.status, 2);
    EXPECT_NE(result.err.find("damaged.weft"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("checksum"), std::string::npos) << result.err;
  }
}

}  // namespace
}  // namespace weft::test
