// --transform and --channel-weights as a user asks for them: every codec under every transform
// through compress, info, verify, decompress and sheet, what is refused, and models that say what
// they hold.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
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

const std::vector<std::string> transforms{"log", "ycrcb", "logluv", "decorrelated"};

std::string write_raw(const std::string& path, const MemorySource& source) {
  const auto sink = create_raw_btf(path, source.info());
  sink->write(0, source.info().shape.images(), source.bytes());
  sink->finish();
  return path;
}

// Values over four decades, as of highlights.
std::string write_bright(const std::string& path) {
  const BtfShape shape{3, 4, 8, 7, 3};
  std::vector<double> values = random_values(shape.values(), 5, -2, 2);
  for (double& value : values) value = std::pow(10.0, value);
  return write_raw(path, *source_of(shape, DType::f32, values));
}

class TransformProcess : public testing::TestWithParam<std::string> {};

std::vector<std::string> codec_names() {
  std::vector<std::string> names;
  for (const Codec* codec : codecs()) names.emplace_back(codec->name());
  return names;
}

INSTANTIATE_TEST_SUITE_P(Table, TransformProcess, testing::ValuesIn(codec_names()),
                         [](const auto& info) {
                           std::string name = info.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(TransformProcess, CompressesVerifiesAndDecompresses) {
  const TemporaryFolder folder;
  const std::string raw = write_bright(folder / "raw.safetensors");
  const std::string model = folder / "m.weft";
  for (const std::string& transform : transforms) {
    SCOPED_TRACE(transform);
    const ProcessResult made = run_weft(
        {"compress", raw, "--codec", GetParam(), GetParam() == "vq" ? "--threshold" : "--rank", "4",
         "--transform", transform, "--channel-weights", "1,0.5,0.5", "--json", "-o", model});
    ASSERT_EQ(made.status, 0) << made.err;
    const json chosen = json::parse(made.out).at("colour_transform");
    EXPECT_EQ(chosen.at("name"), transform);
    EXPECT_EQ(chosen.at("weights"), json({1.0, 0.5, 0.5}));
    if (GetParam() == "pca") {
      const ProcessResult info = run_weft({"info", model, "--json"});
      EXPECT_NE(info.out.find(chosen.dump()), std::string::npos) << info.out;
    }
    const ProcessResult verified = run_weft({"verify", model, "--against", raw, "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    EXPECT_EQ(json::parse(verified.out).at("as_recorded"), true);
    const char* const device = transform == "log" || transform == "ycrcb" ? "auto" : "reference";
    const ProcessResult images = run_weft({"decompress", model, "--channels", "2,0", "--views", "2",
                                           "--device", device, "-o", folder / "part.npy"});
    EXPECT_EQ(images.status, 0) << images.err;
  }
}

TEST(TransformOption, ReferenceFitsAndDeviceVerifies) {
  const TemporaryFolder folder;
  const std::string raw = write_bright(folder / "raw.safetensors");
  for (const std::string& transform : transforms) {
    const ProcessResult made = run_weft({"compress", raw, "--rank", "5", "--transform", transform,
                                         "--device", "reference", "-o", folder / "m.weft"});
    ASSERT_EQ(made.status, 0) << made.err;
    EXPECT_EQ(run_weft({"verify", folder / "m.weft", "--against", raw}).status, 0) << transform;
  }
}

// Log errors are those of the values, on the device as by the reference, recorded and verified.
TEST(TransformOption, LogErrorsAreMeasuredRecordedAndVerified) {
  const TemporaryFolder folder;
  const std::string raw = write_bright(folder / "raw.safetensors");
  for (const std::string transform : {"none", "log"}) {
    const std::string model = folder / "m.weft";
    std::vector<std::string> arguments{"compress", raw,      "--rank", "4",  "--transform",
                                       transform,  "--json", "-o",     model};
    if (transform == "none") arguments.emplace_back("--log-error");
    const ProcessResult made = run_weft(arguments);
    ASSERT_EQ(made.status, 0) << made.err;
    const json errors = json::parse(made.out).at("errors");
    const auto source = open_raw_btf(raw);
    std::vector<std::byte> bytes(source->info().bytes());
    source->read(0, source->info().shape.images(), bytes);
    const std::vector<double> values = decode_values(bytes, DType::f32);
    double sum = 0;
    for (const double value : values) sum += std::abs(value);
    const double scale = sum / static_cast<double>(values.size());
    EXPECT_NEAR(errors.at("log_scale").get<double>(), scale, 1e-9 * scale);
    const auto found = read_model(model);
    std::vector<double> decoded(values.size());
    find_codec("pca").reference_decoder(*found)->decode(0, found->info.btf.shape.images(), decoded);
    double squares = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto l = [&](double x) { return std::copysign(std::log1p(std::abs(x) / scale), x); };
      squares += std::pow(l(values[i]) - l(decoded[i]), 2);
    }
    // The device decodes and takes logarithms in float: 1e-4 is far above its rounding.
    const double rmse = std::sqrt(squares / static_cast<double>(values.size()));
    EXPECT_NEAR(errors.at("log_rmse").get<double>(), rmse, 1e-4 * rmse);
    ASSERT_TRUE(found->info.errors && found->info.errors->log);
    EXPECT_EQ(found->info.errors->log->rmse, errors.at("log_rmse").get<double>());

    const ProcessResult verified = run_weft({"verify", model, "--against", raw, "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    const json rows = json::parse(verified.out).at("log_errors");
    ASSERT_EQ(rows.size(), 3U);
    for (const json& row : rows) {
      EXPECT_NEAR(row.at("log_rmse").get<double>(), rmse, 1e-4 * rmse) << row;
    }
  }
  const ProcessResult alone = run_weft({"verify", folder / "m.weft", "--log-error"});
  EXPECT_EQ(alone.status, 2);
  EXPECT_NE(alone.err.find("--against"), std::string::npos) << alone.err;
}

// What the sink can't hold is clamped, whatever the exponential made of an overshoot.
TEST(TransformOption, HalfOutputOfBrightDataIsFinite) {
  const TemporaryFolder folder;
  std::vector<double> values = random_values(2 * 3 * 6 * 6 * 3, 4, -12, 12);
  for (double& value : values) value = std::exp(value);
  values[7] = 1e30, values[30] = 0, values[31] = 65504;
  const std::string raw =
      write_raw(folder / "raw.safetensors", *source_of({2, 3, 6, 6, 3}, DType::f32, values));
  for (const std::string transform : {"log", "logluv"}) {
    ASSERT_EQ(run_weft({"compress", raw, "--rank", "2", "--transform", transform, "-o",
                        folder / "m.weft"})
                  .status,
              0);
    ASSERT_EQ(run_weft({"verify", folder / "m.weft", "--against", raw}).status, 0);
    ASSERT_EQ(run_weft({"decompress", folder / "m.weft", "--dtype", "f16", "-o",
                        folder / (transform + ".safetensors")})
                  .status,
              0);
    const auto images = open_raw_btf(folder / (transform + ".safetensors"));
    std::vector<std::byte> bytes(images->info().bytes());
    images->read(0, images->info().shape.images(), bytes);
    for (const double value : decode_values(bytes, DType::f16)) {
      ASSERT_TRUE(std::isfinite(value) && std::abs(value) <= 65504);
    }
  }
}

// A picture interpolates decoded values, as one of the raw BTF does: between few directions and
// texels a model under log is as close to that as the model of the same size without, and one that
// holds everything is as the raw BTF is.
TEST(TransformOption, PicturesAreAsCloseAsWithoutATransform) {
  const TemporaryFolder folder;
  const std::string raw = folder / "raw.safetensors", model = folder / "m.weft";
  const ProcessResult made =
      run_weft({"synth", "--material", "hammered", "--size", "16", "--samples", "1", "--dtype",
                "f32", "--view-set", "12", "--light-set", "12", "-o", raw});
  ASSERT_EQ(made.status, 0) << made.err;
  const auto shown_psnr = [&](const std::vector<std::string>& fit, const std::string& device) {
    std::vector<std::string> arguments{"compress", raw, "-o", model};
    arguments.insert(arguments.end(), fit.begin(), fit.end());
    const ProcessResult fitted = run_weft(arguments);
    EXPECT_EQ(fitted.status, 0) << fitted.err;
    const ProcessResult picture =
        run_weft({"render", model, "--compare", raw, "--size", "48", "--device", device, "--json",
                  "-o", folder / "ball.png"});
    EXPECT_EQ(picture.status, 0) << picture.err;
    return json::parse(picture.out).at("errors_as_shown").at("psnr").get<double>();
  };
  const auto of_rank = [&](const std::string& codec, const std::string& transform) {
    return shown_psnr({"--codec", codec, "--rank", "10", "--transform", transform}, "auto");
  };
  const double plain = of_rank("pca", "none");
  EXPECT_GE(of_rank("pca", "log"), plain);
  EXPECT_GE(of_rank("pca", "logluv"), plain);
  EXPECT_GE(of_rank("tt", "log"), of_rank("tt", "none") - 0.5);
  for (const std::string device : {"auto", "reference"}) {
    EXPECT_GE(shown_psnr({"--rank", "432", "--storage", "f32", "--transform", "log"}, device), 60);
  }
}

// A train is cut in the terms that it was fitted in; factors are cut and multiplied in as they are.
TEST(TransformOption, StaysWithWhatIsMadeOfAModel) {
  const TemporaryFolder folder;
  const std::string raw = write_bright(folder / "raw.safetensors");
  ASSERT_EQ(run_weft({"compress", raw, "--codec", "tt", "--transform", "log", "--ranks", "4,4,4,4",
                      "-o", folder / "t.weft"})
                .status,
            0);
  const ProcessResult cut = run_weft({"compress", folder / "t.weft", "--codec", "tt", "--ranks",
                                      "2,2,2,2", "--json", "-o", folder / "u.weft"});
  ASSERT_EQ(cut.status, 0) << cut.err;
  EXPECT_EQ(json::parse(cut.out).at("colour_transform").at("name"), "log");
  EXPECT_EQ(run_weft({"verify", folder / "u.weft", "--against", raw}).status, 0);
  const ProcessResult twice = run_weft({"compress", folder / "t.weft", "--codec", "tt",
                                        "--transform", "logluv", "-o", folder / "u.weft"});
  EXPECT_EQ(twice.status, 2);
  EXPECT_NE(twice.err.find("--transform logluv"), std::string::npos) << twice.err;

  ASSERT_EQ(run_weft({"compress", raw, "--codec", "tucker", "--transform", "decorrelated",
                      "--ranks", "v=2,l=3,y=6,x=6", "-o", folder / "k.weft"})
                .status,
            0);
  ASSERT_EQ(
      run_weft({"reduce", folder / "k.weft", "--ranks", "l=2", "-o", folder / "r.weft"}).status, 0);
  const auto reduced = read_model(folder / "r.weft");
  EXPECT_EQ(reduced->info.colour_transform.kind, ColourTransform::Kind::decorrelated);
  EXPECT_EQ(run_weft({"verify", folder / "r.weft", "--expand", "y,x", "--against", raw}).status, 0);
}

TEST(TransformOption, WhatIsRefusedIsNamed) {
  const TemporaryFolder folder;
  const std::string colour = write_bright(folder / "colour.safetensors");
  const std::string grey =
      write_raw(folder / "grey.safetensors", *random_source({2, 2, 4, 4, 1}, DType::u8, 1));
  const std::string negative = write_raw(folder / "negative.safetensors",
                                         *random_source({2, 2, 4, 4, 3}, DType::f16, 1, -1, 0));
  const struct {
    std::vector<std::string> arguments;
    const char* says;
  } cases[] = {
      {{colour, "--transform", "hsv"}, "--transform: 'hsv' is none of"},
      {{grey, "--transform", "ycrcb"}, "--transform ycrcb: three channels"},
      {{grey, "--transform", "logluv"}, "--transform logluv: three channels"},
      {{negative, "--transform", "logluv"}, "first below 0 at view 0, light 0, row 0, column 0"},
      {{colour, "--channel-weights", "1,2"}, "--channel-weights: 2 weights for 3 channels"},
      {{colour, "--channel-weights", "1,2,"}, "--channel-weights 1,2,"},
      {{colour, "--channel-weights", "1,x,1"}, "--channel-weights 1,x,1"},
      {{colour, "--channel-weights", "1,0,1"}, "--channel-weights 1,0,1"},
      {{colour, "--channel-weights", "1,nan,1"}, "--channel-weights 1,nan,1"},
  };
  for (const auto& wrong : cases) {
    std::vector<std::string> arguments{"compress"};
    arguments.insert(arguments.end(), wrong.arguments.begin(), wrong.arguments.end());
    arguments.insert(arguments.end(), {"-o", folder / "m.weft"});
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2) << wrong.says;
    EXPECT_NE(result.err.find(wrong.says), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder / "m.weft"));
  }
  EXPECT_NE(run_weft({"compress", "--help"}).out.find("decorrelated"), std::string::npos);
  // negative values and one channel have transforms of their own
  for (const std::string& raw : {grey, negative}) {
    for (const std::string transform : {"log", "decorrelated"}) {
      EXPECT_EQ(run_weft({"compress", raw, "--rank", "2", "--transform", transform, "-o",
                          folder / "m.weft"})
                    .status,
                0);
    }
  }
}

}  // namespace
}  // namespace weft::test
