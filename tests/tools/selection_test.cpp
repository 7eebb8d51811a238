// Selections by the program: every subcommand that takes them, on raw BTFs and on models of a part,
// whose views, lights, channels, texels and levels keep the numbers of the whole; and bad requests.
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "selection_options.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/pca.hpp"

namespace weft::test {
namespace {

using nlohmann::json;
using Arguments = std::vector<std::string>;

// Directions 0-6 of the rings at theta 0 and 15, and four of theta 30.
constexpr BtfShape shape{11, 7, 12, 16, 3};

BtfInfo ring_info() {
  BtfInfo info = make_info(shape, DType::f16);
  const std::vector<Direction> rings = ubo81_directions();
  info.view_directions.assign(rings.begin(), rings.begin() + 11);
  info.light_directions.assign(rings.begin(), rings.begin() + 7);
  info.source = "a test";
  return info;
}

std::vector<std::byte> values_of(TileSource& source) {
  std::vector<std::byte> bytes(source.info().bytes());
  source.read(0, source.info().shape.images(), bytes);
  return bytes;
}

std::vector<std::byte> tensor_bytes(const std::string& path) {
  std::vector<std::byte> bytes;
  const auto model = PcaModel::read(ModelFile(path));
  for (const ModelTensor& tensor : model->tensors()) {
    bytes.insert(bytes.end(), tensor.values.begin(), tensor.values.end());
  }
  return bytes;
}

class SelectionProcess : public testing::Test {
 protected:
  void SetUp() override {
    const MemorySource source(ring_info(),
                              encode_values(random_values(shape.values(), 3), DType::f16));
    const auto sink = create_raw_btf(path("cloth.safetensors"), source.info());
    sink->write(0, shape.images(), source.bytes());
    sink->finish();
  }

  std::string path(const std::string& name) const { return folder_ / name; }
  std::string raw() const { return path("cloth.safetensors"); }

  // Runs to success; the report.
  static json done(Arguments arguments) {
    arguments.emplace_back("--json");
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    return result.status == 0 ? json::parse(result.out) : json();
  }
  static void refused(const Arguments& arguments, const std::string& message) {
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(message), std::string::npos) << message << "\n" << result.err;
    EXPECT_EQ(result.out, "");
  }

  // A model of views theta <= 15, lights 2-5, a region at level 1, and channels G and B.
  void make_part() const {
    done({"compress", raw(),       "--codec",  "pca",      "--rank",
          "6",        "--storage", "f32",      "--views",  "theta<=15",
          "--lights", "2-5",       "--region", "2,4,12x8", "--channels",
          "G,B",      "--level",   "1",        "-o",       path("part.weft")});
  }
  std::vector<std::byte> decompressed(const Arguments& options, const std::string& model) const {
    Arguments arguments{"decompress", path(model), "--dtype", "f32", "-o", path("out.safetensors")};
    arguments.insert(arguments.end(), options.begin(), options.end());
    done(arguments);
    return values_of(*open_raw_btf(path("out.safetensors")));
  }

  TemporaryFolder folder_;
};

TEST_F(SelectionProcess, ImportKeepsWhereItCameFrom) {
  const json report =
      done({"import", raw(), "--views", "theta<=15&phi=60..180", "--lights", "0-6:3", "--channels",
            "B", "--region", "center:4x4", "-o", path("part.safetensors")});
  EXPECT_EQ(report.at("selection").at("views"), json({0, 2, 3, 4}));
  EXPECT_EQ(report.at("selection").at("lights"), json({0, 3, 6}));
  EXPECT_EQ(report.at("shape"), json({4, 3, 4, 4, 1}));
  EXPECT_EQ(report.at("source"),
            "a test (views 0,2-4 of 11; lights 0,3,6 of 7; region 6,4,4x4 of 16 x 12; channels 2 "
            "of 3)");
  EXPECT_EQ(open_raw_btf(path("part.safetensors"))->info().source, report.at("source"));
  refused({"import", raw(), "--views", "theta>30", "-o", path("x.safetensors")},
          "--views: 'theta>30' selects none of the 11 there are");
  refused({"import", raw(), "--level", "5", "-o", path("x.safetensors")}, "--level 5");
}

TEST_F(SelectionProcess, APartIsFittedAsIfItWereAlone) {
  const Arguments part{"--views", "theta>=15", "--lights", "cone=15/0/20", "--region", "1,2,9x8"};
  Arguments import{"import", raw(), "-o", path("part.safetensors")};
  import.insert(import.end(), part.begin(), part.end());
  done(import);
  done({"compress", path("part.safetensors"), "--rank", "4", "-o", path("alone.weft")});
  Arguments compress{"compress", raw(), "--rank", "4", "-o", path("part.weft")};
  compress.insert(compress.end(), part.begin(), part.end());
  const json report = done(compress);
  EXPECT_EQ(report.at("shape"), json({10, 4, 8, 9, 3}));
  EXPECT_EQ(report.at("selection").at("lights"), json({0, 1, 2, 6}));
  EXPECT_EQ(report.at("selection").at("of"), json({11, 7, 12, 16, 3}));
  EXPECT_EQ(tensor_bytes(path("part.weft")), tensor_bytes(path("alone.weft")));
}

TEST_F(SelectionProcess, InfoSaysWhatAModelHolds) {
  make_part();
  const ProcessResult result = run_weft({"info", path("part.weft")});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("views 0-6 of 11; lights 2-5 of 7; region 2,4,12x8 of 16 x 12; "
                            "channels 1-2 of 3; level 1"),
            std::string::npos)
      << result.out;
  EXPECT_NE(result.out.find("theta 0 to 15 degrees"), std::string::npos) << result.out;
}

TEST_F(SelectionProcess, DecompressCountsInTheWhole) {
  make_part();
  const std::vector<std::byte> whole = decompressed({}, "part.weft");
  ASSERT_EQ(whole.size(), 7U * 4 * 4 * 6 * 2 * sizeof(float));
  EXPECT_EQ(decompressed({"--level", "1", "--views", "theta<=90"}, "part.weft"), whole);
  // views 6 and 1, light 3, texels 4,6 to 9,9 at level 1, channel B
  const std::vector<std::byte> part = decompressed(
      {"--views", "6,1", "--lights", "3", "--region", "4,6,6x4", "--channels", "B"}, "part.weft");
  std::vector<std::byte> expected;
  for (const std::size_t v : {6, 1}) {
    for (std::size_t y = 1; y < 3; ++y) {
      for (std::size_t x = 1; x < 4; ++x) {
        const auto at =
            static_cast<std::ptrdiff_t>(((((v * 4 + 1) * 4 + y) * 6 + x) * 2 + 1) * sizeof(float));
        expected.insert(expected.end(), whole.begin() + at, whole.begin() + at + sizeof(float));
      }
    }
  }
  EXPECT_EQ(part, expected);
  const auto written = open_raw_btf(path("out.safetensors"));
  EXPECT_EQ(written->info().view_directions[0], ring_info().view_directions[6]);
  EXPECT_EQ(written->info().source,
            "a test (views 6,1 of 11; lights 3 of 7; region 4,6,6x4 of 16 x 12; channels 2 of 3; "
            "level 1)");

  const std::vector<std::byte> coarser = decompressed({"--level", "2"}, "part.weft");
  EXPECT_EQ(coarser.size(), 7U * 4 * 2 * 3 * 2 * sizeof(float));

  const std::pair<Arguments, std::string> outside[] = {
      {{"--views", "7"}, "--views: 7 of '7' is not in"},
      {{"--views", "11"}, "--views: '11' is out of range: there are 11"},
      {{"--lights", "0-3"}, "--lights: 0 of '0-3' is not in"},
      {{"--channels", "R"}, "--channels: 'R'"},
      {{"--channels", "0"}, "which holds 1-2 of 3"},
      {{"--region", "0,4,4x4"}, "does not lie within the 2,4,12x8 that"},
      {{"--region", "3,4,4x4"}, "cuts texels"},
      {{"--level", "0"}, "part.weft holds mip level 1 and none that is finer"},
      {{"--level", "5"}, "--level 5: the last mip level of 6 x 4 texels is 4"},
  };
  for (const auto& [options, message] : outside) {
    Arguments arguments{"decompress", path("part.weft"), "-o", path("x.npy")};
    arguments.insert(arguments.end(), options.begin(), options.end());
    refused(arguments, message);
  }
  EXPECT_FALSE(std::filesystem::exists(path("x.npy")));
}

TEST_F(SelectionProcess, VerifyTakesThePartAndNarrowsIt) {
  make_part();
  const auto verified = [&](const Arguments& options) {
    Arguments arguments{"verify", path("part.weft"), "--against", raw()};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return done(arguments);
  };
  const json whole = verified({});
  EXPECT_EQ(whole.at("as_recorded"), true);
  EXPECT_EQ(whole.at("values"), 7 * 4 * 4 * 6 * 2);
  const json part = verified({"--views", "theta=15&phi=0..120", "--region", "6,4,4x8"});
  EXPECT_EQ(part.at("selection").at("views"), json({1, 2, 3}));
  EXPECT_EQ(part.at("values"), 3 * 4 * 4 * 2 * 2);
  EXPECT_FALSE(part.contains("as_recorded"));
  // What is averaged differs less.
  const json level = verified({"--level", "2"});
  EXPECT_LT(level.at("errors")[0].at("rmse").get<double>(),
            whole.at("errors")[0].at("rmse").get<double>());
  EXPECT_NEAR(level.at("errors")[0].at("rmse").get<double>(),
              level.at("errors")[1].at("rmse").get<double>(), 1e-6);

  refused({"verify", path("part.weft"), "--level", "2"}, "--against names the raw BTF");
  refused({"verify", path("part.weft"), "--views", "8"}, "--views: 8 of '8' is not in");
  done({"import", raw(), "--views", "0-7", "-o", path("less.safetensors")});
  refused({"verify", path("part.weft"), "--against", path("less.safetensors")},
          "of the BTF that the model was made of is [11,7,12,16,3], this one's is [8,7,12,16,3]");
}

TEST_F(SelectionProcess, ModelsOfModelsKeepTheSelection) {
  done({"compress", raw(), "--codec", "tt", "--ranks", "4,4,3,3", "--views", "5,2-3", "-o",
        path("train.weft")});
  done({"compress", path("train.weft"), "--codec", "tt", "--ranks", "3,3,3,2", "-o",
        path("shorter.weft")});
  done({"compress", raw(), "--codec", "tucker", "--ranks", "v=3,l=3", "--views", "5,2-3", "-o",
        path("tensor.weft")});
  done({"reduce", path("tensor.weft"), "--ranks", "l=2", "-o", path("less.weft")});
  for (const char* model : {"shorter.weft", "less.weft"}) {
    const std::vector<std::byte> all = decompressed({}, model);
    const std::vector<std::byte> one = decompressed({"--views", "2"}, model);
    const std::size_t view = all.size() / 3;
    ASSERT_EQ(one.size(), view) << model;
    EXPECT_TRUE(std::equal(one.begin(), one.end(), all.begin() + static_cast<std::ptrdiff_t>(view)))
        << model;
    refused({"decompress", path(model), "--views", "0", "-o", path("x.npy")},
            "which holds 5,2-3 of 11");
    done({"verify", path(model), "--against", raw(), "--views", "3"});
  }
}

TEST_F(SelectionProcess, SheetsAndRendersTakeParts) {
  make_part();
  // beside a model of a part, that part of the original
  json report = done({"sheet", raw(), path("part.weft"), "--columns", "3", "-o", path("s.png")});
  EXPECT_EQ(report.at("images"), 3);
  report = done({"sheet", raw(), path("part.weft"), "--views", "theta=15", "--lights", "3", "-o",
                 path("s.png")});
  EXPECT_EQ(report.at("images"), 6);
  report = done({"sheet", path("part.weft"), "--views", "6", "--lights", "5", "-o", path("s.png")});
  EXPECT_EQ(report.at("images"), 1);
  report = done({"sheet", raw(), "--views", "0", "--lights", "0-1", "--region", "center:8x8", "-o",
                 path("s.png")});
  EXPECT_EQ(report.at("width"), 2 * (8 + 4) + 4);
  refused({"sheet", raw(), path("part.weft"), "--views", "9", "-o", path("x.png")},
          "--views: 9 of '9' is not in");

  report = done({"render", raw(), "--size", "24", "--samples", "1", "--views", "theta<=15",
                 "--lights", "theta<=15", "--compare", raw(), "-o", path("r.png")});
  EXPECT_GT(report.at("errors_as_shown").at("rmse").get<double>(), 0);
  done({"compress", raw(), "--rank", "3", "--views", "1-9", "-o", path("grid.weft")});
  done({"render", path("grid.weft"), "--size", "24", "--samples", "1", "--views", "1-6", "--level",
        "1", "-o", path("r.png")});
  refused({"render", path("grid.weft"), "--views", "0", "-o", path("x.png")},
          "--views: 0 of '0' is not in");
  refused({"render", raw(), "--channels", "0,1", "-o", path("x.png")}, "2 channels");
}

TEST_F(SelectionProcess, BenchTakesParts) {
  make_part();
  const json report = done({"bench", "--model", path("part.weft"), "--filter", "texel", "--views",
                            "1-6", "--region", "2,4,4x4"});
  EXPECT_EQ(report.at("selection").at("views"), json({1, 2, 3, 4, 5, 6}));
  refused({"bench", "--model", path("part.weft"), "--views", "7"}, "--views: 7 of '7' is not in");
}

TEST_F(SelectionProcess, PairsHaveNoLightsOfTheirOwn) {
  BtfInfo info = make_info({6, 1, 8, 8, 3}, DType::f16);
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  const MemorySource source(info, encode_values(random_values(info.shape.values(), 3), DType::f16));
  const auto sink = create_raw_btf(path("pairs.safetensors"), info);
  sink->write(0, 6, source.bytes());
  sink->finish();
  done({"compress", path("pairs.safetensors"), "--rank", "2", "--views", "1-4", "-o",
        path("pairs.weft")});
  done({"decompress", path("pairs.weft"), "--views", "4", "-o", path("four.safetensors")});
  EXPECT_EQ(open_raw_btf(path("four.safetensors"))->info().light_directions.at(0),
            info.light_directions[4]);
  for (const char* file : {"pairs.safetensors", "pairs.weft"}) {
    refused({file == std::string("pairs.weft") ? "decompress" : "import", path(file), "--lights",
             "0", "-o", path("x.safetensors")},
            "a paired BTF has no lights of its own; select views (pairs)");
  }
}

TEST_F(SelectionProcess, RecordsThatDoNotFitAreRefused) {
  make_part();
  const auto model = PcaModel::read(ModelFile(path("part.weft")));
  model->info.selection = R"({"views":[0,1]})";
  write_model(path("lying.weft"), *model);
  for (const Arguments& arguments :
       {Arguments{"info", path("lying.weft")},
        Arguments{"decompress", path("lying.weft"), "-o", path("x.npy")},
        Arguments{"verify", path("lying.weft")}}) {
    refused(arguments, "lying.weft: metadata \"selection\"");
  }
}

TEST(SelectionOptions, GoOnToOtherProcesses) {
  SelectionOptions options;
  EXPECT_EQ(selection_arguments(options), Arguments{});
  CLI::App program;
  add_selection_options(program, options);
  const Arguments given{"--views",    "theta<=60",  "--lights", "0-3",     "--region",
                        "center:4x4", "--channels", "R",        "--level", "0"};
  program.parse(Arguments(given.rbegin(), given.rend()));
  EXPECT_EQ(selection_arguments(options), given);
}

TEST(SelectionOptions, HelpNamesThem) {
  for (const char* command :
       {"import", "compress", "decompress", "verify", "sheet", "render", "bench"}) {
    const ProcessResult result = run_weft({command, "--help"});
    EXPECT_EQ(result.status, 0);
    for (const char* word :
         {"--views", "--lights", "--region", "--channels", "--level", "theta<=60", "center:"}) {
      EXPECT_NE(result.out.find(word), std::string::npos) << command << " " << word;
    }
  }
}

}  // namespace
}  // namespace weft::test
