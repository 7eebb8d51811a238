// weft render as a process: what known materials must show, every option, bad usage, hostile files.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "support/generators.hpp"
#include "support/image_files.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/btf/directions.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/io/image.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Arguments = std::vector<std::string>;

constexpr double pi = std::numbers::pi;

void write_raw(const fs::path& path, BtfInfo info, std::span<const double> values) {
  info.dtype = DType::f32;
  const auto sink = create_raw_btf(path, info);
  sink->write(0, info.shape.images(), encode_values(values, info.dtype));
  sink->finish();
}

// A BTF of ubo81 directions, [81][81][Y][X][3].
BtfInfo full_info(std::size_t height, std::size_t width) {
  BtfInfo info = make_info({81, 81, height, width, 3});
  info.view_directions = ubo81_directions();
  info.light_directions = ubo81_directions();
  info.encoding = Encoding::linear;
  return info;
}

// A matt surface of the given albedo: T = albedo / pi cos(theta_l), or without the cosine where the
// values are a BRDF.
std::string write_diffuse(const fs::path& path, double albedo, Quantity quantity) {
  BtfInfo info = full_info(2, 2);
  info.quantity = quantity;
  std::vector<double> values;
  for (std::size_t image = 0; image < info.shape.images(); ++image) {
    const double theta = theta_degrees(info.light_directions[image % 81]) * pi / 180;
    values.insert(values.end(), info.shape.image_values(),
                  albedo / pi * (quantity == Quantity::radiance ? std::cos(theta) : 1.0));
  }
  write_raw(path, info, values);
  return path;
}

std::string write_random(const fs::path& path, std::uint64_t seed) {
  const BtfInfo info = full_info(4, 6);
  write_raw(path, info, random_values(info.shape.values(), seed, 0.0, 0.3));
  return path;
}

std::vector<float> light_of(const fs::path& exr) {
  const ImageInfo info = image_info(exr);
  EXPECT_EQ(info.dtype, DType::f32);
  std::vector<float> values(info.height * info.width * info.channels);
  read_image(exr, info, std::as_writable_bytes(std::span(values)));
  return values;
}

// The middle pixel.
std::array<double, 3> middle_of(const fs::path& exr) {
  const ImageInfo info = image_info(exr);
  const std::vector<float> light = light_of(exr);
  const std::size_t at = (info.height / 2 * info.width + info.width / 2) * 3;
  return {static_cast<double>(light[at]), static_cast<double>(light[at + 1]),
          static_cast<double>(light[at + 2])};
}

class Render : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  std::size_t entries() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()));
  }
  ProcessResult render(Arguments arguments) const {
    arguments.insert(arguments.begin(), "render");
    return run_weft(arguments);
  }
  json report(Arguments arguments) const {
    arguments.insert(arguments.end(), {"--json", "--quiet"});
    const ProcessResult result = render(arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    return result.status == 0 ? json::parse(result.out) : json();
  }

  TemporaryFolder folder_;
};

// On a plane under one light E from a measured direction, a matt surface shows
// albedo / pi cos(theta_l) E, whatever the view. Weights and values in float, 28 of them at most.
TEST_F(Render, AMattPlaneShowsItsAlbedo) {
  const std::string brdf = write_diffuse(path("brdf.safetensors"), 0.6, Quantity::brdf);
  const std::string radiance = write_diffuse(path("radiance.safetensors"), 0.6, Quantity::radiance);
  for (const std::string device : {"auto", "reference"}) {
    for (const std::string& input : {brdf, radiance}) {
      SCOPED_TRACE(device + " " + input);
      report({input, "--shape", "plane", "--light", "30,0,2,1,0.5", "--turn", "37,-65", "--size",
              "9x7", "--device", device, "-o", path("p.exr")});
      const std::array<double, 3> found = middle_of(path("p.exr"));
      const double expected = 0.6 / pi * std::cos(pi / 6);
      EXPECT_NEAR(found[0], 2 * expected, 64 * 0x1p-24 * 2 * expected);
      EXPECT_NEAR(found[1], expected, 64 * 0x1p-24 * expected);
      EXPECT_NEAR(found[2], expected / 2, 64 * 0x1p-24 * expected);
    }
  }
}

TEST_F(Render, LightsAddUp) {
  const std::string input = write_random(path("raw.safetensors"), 1);
  const Arguments common{input, "--size", "16", "--samples", "2", "-o"};
  const auto with = [&](const std::string& name, const Arguments& more) {
    Arguments arguments = common;
    arguments.push_back(path(name));
    arguments.insert(arguments.end(), more.begin(), more.end());
    arguments.insert(arguments.end(), {"--background", "0", "--exposure", "0"});
    report(arguments);
    return light_of(path(name));
  };
  const std::vector<float> one = with("a.exr", {"--light", "40,-60,1"});
  const std::vector<float> other = with("b.exr", {"--light", "60,-130,2,0,1"});
  const std::vector<float> both =
      with("c.exr", {"--light", "40,-60,1", "--light", "60,-130,2,0,1"});
  double brightest = 0;
  for (std::size_t i = 0; i < both.size(); ++i) {
    EXPECT_NEAR(both[i], one[i] + other[i], 1e-6f);
    brightest = std::max(brightest, static_cast<double>(both[i]));
  }
  EXPECT_GT(brightest, 0.1);
}

// A matt surface of albedo a under radiance L from all round shows a L. The estimate has a variance
// of at most (16/6 - 1) (a L)^2 per sample, drawn evenly from the sphere: 4 standard deviations.
TEST_F(Render, AConstantEnvironmentShowsTheAlbedo) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const std::vector<float> map(8 * 16 * 3, 0.75f);
  write_exr(path("map.exr"), {8, 16, 3, DType::f32}, std::as_bytes(std::span(map)),
            ExrCompression::none);
  report({input, "--shape", "plane", "--environment", path("map.exr"), "--light-samples", "256",
          "--turn", "0,0", "--fov", "10", "--samples", "1", "--size", "12", "-o", path("p.exr")});
  const std::vector<float> light = light_of(path("p.exr"));
  double sum = 0;
  for (const float value : light) sum += static_cast<double>(value);
  const double expected = 0.5 * 0.75;
  EXPECT_NEAR(sum / static_cast<double>(light.size()), expected,
              4 * expected * std::sqrt(10.0 / 6 / (12 * 12 * 256)));
  // scaled, and turned
  report({input,
          "--shape",
          "plane",
          "--environment",
          path("map.exr"),
          "--light-samples",
          "256",
          "--turn",
          "0,0",
          "--fov",
          "10",
          "--samples",
          "1",
          "--size",
          "12",
          "--rotate",
          "77",
          "--environment-scale",
          "2",
          "-o",
          path("q.exr")});
  double scaled = 0;
  for (const float value : light_of(path("q.exr"))) scaled += static_cast<double>(value);
  EXPECT_NEAR(scaled / static_cast<double>(light.size()), 2 * expected,
              8 * expected * std::sqrt(10.0 / 6 / (12 * 12 * 256)));
}

// However its samples are drawn, at no more noise than by even samples of the sphere. The
// material's own are drawn nearly by the cosine, and leave almost none.
TEST_F(Render, EveryWayOfSamplingShowsTheAlbedo) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const std::vector<float> map(8 * 16 * 3, 0.75f);
  write_exr(path("map.exr"), {8, 16, 3, DType::f32}, std::as_bytes(std::span(map)),
            ExrCompression::none);
  std::map<std::string, double> noise;
  for (const std::string device : {"auto", "reference"}) {
    for (const std::string way : {"light", "material", "both"}) {
      SCOPED_TRACE(device + " " + way);
      const json found = report({input,
                                 "--shape",
                                 "plane",
                                 "--environment",
                                 path("map.exr"),
                                 "--light-samples",
                                 "64",
                                 "--sampling",
                                 way,
                                 "--noise",
                                 "--turn",
                                 "0,0",
                                 "--fov",
                                 "10",
                                 "--samples",
                                 "1",
                                 "--size",
                                 "12",
                                 "--device",
                                 device,
                                 "-o",
                                 path("p.exr")});
      EXPECT_EQ(found.at("sampling"), way);
      noise[way] = found.at("noise").get<double>();
      const std::vector<float> light = light_of(path("p.exr"));
      double sum = 0;
      for (const float value : light) sum += static_cast<double>(value);
      const double expected = 0.5 * 0.75, deviation = std::sqrt(10.0 / 6 / 64);
      EXPECT_NEAR(sum / static_cast<double>(light.size()), expected, 4 * expected * deviation / 12);
      // samples are well spread, which makes it less
      EXPECT_LT(noise[way], deviation);
      const bool has_tables = found.at("stages").dump().find("light tables") != std::string::npos;
      EXPECT_EQ(has_tables, way != "light");
    }
    EXPECT_LT(noise["material"], 0.5 * noise["light"]);
    EXPECT_LT(noise["both"], noise["light"]);
  }
  // nothing is drawn without an environment
  report({input, "--light", "20,30", "--sampling", "both", "--size", "12", "-o", path("q.exr")});
}

TEST_F(Render, PlansEnvironmentAndMesh) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const std::vector<float> map(32 * 64 * 3, 0.75f);
  write_exr(path("map.exr"), {32, 64, 3, DType::f32}, std::as_bytes(std::span(map)),
            ExrCompression::none);
  const ProcessResult result = render({input, "--shape", "drape", "--environment", path("map.exr"),
                                       "--sampling", "both", "--size", "12", "-o", path("p.exr")});
  EXPECT_EQ(result.status, 0);
  for (const char* item : {"environment map 40", "mesh ", "tables to draw lights from "}) {
    EXPECT_NE(result.err.find(item), std::string::npos) << item << " in " << result.err;
  }
  // they count: a limit that holds what there is but for the mesh is refused
  const ProcessResult refused =
      render({input, "--shape", "drape", "--memory", "1M", "--size", "12", "-o", path("q.exr")});
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.err.find("mesh"), std::string::npos) << refused.err;
  EXPECT_FALSE(fs::exists(path("q.exr")));
}

// Weights of directions solve a system of three unit vectors about 15 degrees apart, whose inverse
// has elements up to about 60: in float they are off by 3 x 60 x 2^-24 each, for view and light.
// Values are at most 0.3, and all lights together at most 16.
TEST_F(Render, DeviceAndReferenceShowTheSame) {
  constexpr double tolerance = 2 * 3 * 60 * 0x1p-24 * 0.3 * 16;
  const std::string raw = write_random(path("raw.safetensors"), 2);
  const std::string model = path("m.weft");
  ASSERT_EQ(run_weft({"compress", raw, "--rank", "3", "-o", model}).status, 0);
  const std::vector<std::pair<std::string, std::string>> cases{{raw, "sphere"}, {model, "drape"}};
  for (const auto& [input, shape] : cases) {
    SCOPED_TRACE(input + " " + shape);
    const auto on = [&, input = input, shape = shape](const std::string& device) {
      report({input, "--shape", shape, "--size", "12", "--samples", "2", "--light-samples", "2",
              "--exposure", "0", "-o", path(device + ".exr"), "--device", device});
      return light_of(path(device + ".exr"));
    };
    const std::vector<float> expected = on("reference");
    const std::vector<float> found = on("auto");
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], tolerance);
  }
}

TEST_F(Render, ComparedWithItselfIsExact) {
  const std::string input = write_random(path("raw.safetensors"), 3);
  const json same = report({input, "--compare", input, "--size", "24x20", "-o", path("p.png")});
  EXPECT_EQ(same.at("errors_as_shown").at("psnr"), "inf");
  EXPECT_NEAR(same.at("errors_as_shown").at("ssim").get<double>(), 1.0, 1e-14);
  EXPECT_EQ(same.at("errors_of_light").at("rmse"), 0.0);
  EXPECT_EQ(same.at("original"), path("p-original.png"));
  EXPECT_EQ(same.at("difference"), path("p-difference.png"));
  EXPECT_EQ(file_bytes(path("p.png")), file_bytes(path("p-original.png")));
  const ImageInfo info = image_info(path("p-difference.png"));
  EXPECT_EQ(info, (ImageInfo{20, 24, 3, DType::u8}));
  std::vector<std::byte> pixels(info.bytes());
  read_image(path("p-difference.png"), info, pixels);
  EXPECT_TRUE(
      std::all_of(pixels.begin(), pixels.end(), [](std::byte b) { return b == std::byte{}; }));
}

// The figures are those of the files: PNG as shown, 8 bits per value.
TEST_F(Render, ComparesAModelWithItsRawBtf) {
  const std::string raw = write_random(path("raw.safetensors"), 4);
  const std::string model = path("m.weft");
  ASSERT_EQ(run_weft({"compress", raw, "--rank", "2", "-o", model}).status, 0);
  const json compared = report({model, "--compare", raw, "--size", "24", "--difference", "2",
                                "--light", "30,-90", "-o", path("p.exr")});
  const json& errors = compared.at("errors_of_light");
  const std::vector<float> found = light_of(path("p.exr"));
  const std::vector<float> original = light_of(path("p-original.exr"));
  double squares = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const double d = static_cast<double>(found[i]) - static_cast<double>(original[i]);
    squares += d * d;
  }
  EXPECT_GT(squares, 0);
  EXPECT_NEAR(errors.at("rmse").get<double>(),
              std::sqrt(squares / static_cast<double>(found.size())), 1e-9);
  EXPECT_EQ(compared.at("errors_as_shown").at("psnr_peak"), 1.0);
  const double ssim = compared.at("errors_as_shown").at("ssim").get<double>();
  EXPECT_GT(ssim, 0.1);
  EXPECT_LT(ssim, 0.99999);
  EXPECT_TRUE(fs::exists(path("p-difference.png")));
}

TEST_F(Render, FramesAreNumbered) {
  const std::string input = write_random(path("raw.safetensors"), 5);
  const Arguments common{input, "--size", "12", "--light", "50,-120", "--exposure", "1"};
  const auto with = [&](Arguments more) {
    more.insert(more.begin(), common.begin(), common.end());
    return report(more);
  };
  EXPECT_EQ(with({"--turntable", "3", "-o", path("t")}).at("frames"), 3);
  with({"--light-sweep", "2", "--format", "exr", "-o", path("l/")});
  with({"-o", path("p.png")});
  with({"-o", path("p.exr")});
  EXPECT_EQ(file_bytes(path("t/frame-00000.png")), file_bytes(path("p.png")));
  EXPECT_TRUE(fs::exists(path("t/frame-00002.png")));
  EXPECT_FALSE(fs::exists(path("t/frame-00003.png")));
  EXPECT_EQ(light_of(path("l/frame-00000.exr")), light_of(path("p.exr")));
  EXPECT_NE(light_of(path("l/frame-00001.exr")), light_of(path("p.exr")));
  // a folder that holds something is left alone
  EXPECT_EQ(render({input, "--size", "12", "--turntable", "2", "-o", path("t")}).status, 2);
}

// A turntable leaves lights and camera where they are: a matt ball looks the same in all frames.
TEST_F(Render, OnATurntableTheShapeTurns) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  report({input, "--size", "12", "--light", "50,-120", "--exposure", "0", "--turntable", "3",
          "--format", "exr", "-o", path("t")});
  const std::vector<float> first = light_of(path("t/frame-00000.exr"));
  const std::vector<float> second = light_of(path("t/frame-00001.exr"));
  for (std::size_t i = 0; i < first.size(); ++i) EXPECT_NEAR(first[i], second[i], 2e-4f) << i;
}

TEST_F(Render, IsTheSameTwiceAndWithLittleMemory) {
  const std::string input = write_random(path("raw.safetensors"), 6);
  const auto picture = [&](const Arguments& more) {
    Arguments arguments{input, "--size", "40", "--samples", "2", "-o", path("p.exr")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    report(arguments);
    return light_of(path("p.exr"));
  };
  const std::vector<float> expected = picture({});
  EXPECT_EQ(picture({}), expected);
  EXPECT_EQ(picture({"--memory", "64MiB"}), expected);
  EXPECT_NE(picture({"--seed", "2"}), expected);
  EXPECT_EQ(render({input, "--memory", "100KiB", "-o", path("q.png")}).status, 2);
}

TEST_F(Render, ReportsTimesAndWhatWasRendered) {
  const std::string input = write_random(path("raw.safetensors"), 7);
  const json found = report({input, "--size", "16x12", "--samples", "3", "-o", path("p.png")});
  EXPECT_EQ(image_info(path("p.png")), (ImageInfo{12, 16, 3, DType::u8}));
  EXPECT_EQ(found.at("width"), 16);
  EXPECT_EQ(found.at("samples"), 3);
  EXPECT_EQ(found.at("shape"), "sphere");
  EXPECT_GT(found.at("frames_per_second").get<double>(), 0);
  EXPECT_TRUE(found.at("exposure").is_number());
  EXPECT_GE(found.at("stages").size(), 2u);
  const ProcessResult text = render({input, "--size", "8", "-o", path("p.png")});
  EXPECT_NE(text.out.find("frames per second"), std::string::npos) << text.out;
}

// A dark exposure makes the background's light bright: it stays a float, also behind what hides it.
TEST_F(Render, TheBrightestBackgroundIsFinite) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  report({input, "--size", "12", "--background", "1e6", "--exposure", "-100", "-o", path("p.exr")});
  const std::vector<float> light = light_of(path("p.exr"));
  for (const float value : light) EXPECT_TRUE(std::isfinite(value));
  EXPECT_NEAR(light[0], 0x1p100 * 1e6, 1e-6 * 0x1p100 * 1e6);
  EXPECT_LT(middle_of(path("p.exr"))[0], 1);
}

TEST_F(Render, BackgroundCameraAndToneAreAsAsked) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  // the corner shows the background as given, whatever the exposure
  for (const std::string exposure : {"auto", "-2"}) {
    report({input, "--size", "12", "--background", "0.2,0.4,0.6", "--exposure", exposure, "-o",
            path("p.png")});
    std::vector<std::byte> pixels(12 * 12 * 3);
    read_image(path("p.png"), {12, 12, 3, DType::u8}, pixels);
    for (std::size_t c = 0; c < 3; ++c) {
      const double wanted = encode_from_linear(Encoding::srgb, 0.2 + 0.2 * static_cast<double>(c));
      EXPECT_NEAR(std::to_integer<int>(pixels[c]), 255 * wanted, 0.51);
    }
  }
  // --eye is the same camera as --turn and --distance
  const Arguments common{input, "--shape", "plane", "--size", "8", "--light", "20,10", "-o"};
  const auto seen = [&](const Arguments& more) {
    Arguments arguments = common;
    arguments.push_back(path("p.exr"));
    arguments.insert(arguments.end(), more.begin(), more.end());
    report(arguments);
    return light_of(path("p.exr"));
  };
  const std::vector<float> turned =
      seen({"--turn", "90,0", "--distance", "3", "--target", "0,0,4"});
  EXPECT_EQ(seen({"--eye", "3,0,4", "--target", "0,0,4"}), turned);
  // tone curves change the picture
  report({input, "--size", "8", "--exposure", "2", "-o", path("linear.png")});
  report({input, "--size", "8", "--exposure", "2", "--tone", "reinhard", "-o", path("tone.png")});
  EXPECT_NE(file_bytes(path("linear.png")), file_bytes(path("tone.png")));
}

TEST_F(Render, AMeshWearsTheMaterial) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.6, Quantity::brdf);
  write_text(path("square.obj"),
             "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
             "f 1/1 2/2 3/3 4/4\n");
  report({input, "--shape", path("square.obj"), "--up-axis", "z", "--repeat", "2x3", "--light",
          "30,0,1", "--turn", "40,-90", "--size", "9", "-o", path("p.exr")});
  const double expected = 0.6 / pi * std::cos(pi / 6);
  EXPECT_NEAR(middle_of(path("p.exr"))[1], expected, 1e-5);
}

TEST_F(Render, HostileFilesAreNamed) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const std::vector<std::pair<std::string, std::string>> shapes{
      {"empty.obj", ""},
      {"index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 99/1\n"},
      {"text.obj", "v a b c\n"},
      {"nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"},
      {"plain.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"}};
  for (const auto& [name, text] : shapes) {
    write_text(path(name), text);
    const ProcessResult result = render({input, "--shape", path(name), "-o", path("p.png")});
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(name), std::string::npos) << result.err;
  }
  const std::vector<std::pair<std::string, std::string>> maps{
      {"empty.hdr", ""},
      {"cut.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\nabc"},
      {"huge.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 999999999 +X 999999999\n"},
      {"text.exr", "no picture"}};
  for (const auto& [name, text] : maps) {
    write_text(path(name), text);
    const ProcessResult result = render({input, "--environment", path(name), "-o", path("p.png")});
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(name), std::string::npos) << result.err;
  }
  EXPECT_FALSE(fs::exists(path("p.png")));
}

TEST_F(Render, BadUsageIsStatusTwoAndLeavesNothing) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const std::string output = path("p.png");
  fs::create_directory(path("d-difference.png"));
  const std::size_t before = entries();
  for (const Arguments& arguments :
       std::vector<Arguments>{{},
                              {input},
                              {input, "--compare", input, "-o", path("d.png")},
                              {input, "-o", path("p.jpg")},
                              {input, "-o", path("no/p.png")},
                              {path("none.safetensors"), "-o", output},
                              {input, "--shape", "cube", "-o", output},
                              {input, "--shape", path("none.obj"), "-o", output},
                              {input, "--repeat", "0", "-o", output},
                              {input, "--repeat", "2xa", "-o", output},
                              {input, "--size", "0", "-o", output},
                              {input, "--size", "12by12", "-o", output},
                              {input, "--samples", "0", "-o", output},
                              {input, "--seed", "-1", "-o", output},
                              {input, "--eye", "1,2", "-o", output},
                              {input, "--eye", "0,0,0", "-o", output},
                              {input, "--eye", "1,2,3", "--turn", "20,30", "-o", output},
                              {input, "--turn", "200,0", "-o", output},
                              {input, "--turn", "20", "-o", output},
                              {input, "--target", "0,0,nan", "-o", output},
                              {input, "--distance", "-1", "-o", output},
                              {input, "--distance", "nan", "-o", output},
                              {input, "--distance", "inf", "-o", output},
                              {input, "--fov", "180", "-o", output},
                              {input, "--light", "30", "-o", output},
                              {input, "--light", "30,40,-1", "-o", output},
                              {input, "--light", "30,40,1,2", "-o", output},
                              {input, "--light", "190,40", "-o", output},
                              {input, "--light", "30,40,inf", "-o", output},
                              {input, "--environment", path("none.hdr"), "-o", output},
                              {input, "--light-samples", "0", "-o", output},
                              {input, "--environment-scale", "-1", "-o", output},
                              {input, "--sampling", "bright", "-o", output},
                              {input, "--sampling", "-o", output},
                              {input, "--noise", "--turntable", "2", "-o", path("t")},
                              {input, "--exposure", "bright", "-o", output},
                              {input, "--exposure", "1000", "-o", output},
                              {input, "--tone", "filmy", "-o", output},
                              {input, "--background", "1,2", "-o", output},
                              {input, "--background", "-1", "-o", output},
                              {input, "--background", "1e39", "-o", output},
                              {input, "--turntable", "0", "-o", path("t")},
                              {input, "--turntable", "2", "--light-sweep", "2", "-o", path("t")},
                              {input, "--turntable", "2", "--compare", input, "-o", path("t")},
                              {input, "--compare", path("none.safetensors"), "-o", output},
                              {input, "--compare", input, "--size", "10", "-o", output},
                              {input, "--difference", "0", "--compare", input, "-o", output},
                              {input, "--difference", "nan", "--compare", input, "-o", output},
                              {input, "--turntable", "2", "-o", output},
                              {input, "--light-sweep", "2", "-o", path("p.exr")},
                              {input, "--device", "no such device", "-o", output}}) {
    const ProcessResult result = render(arguments);
    EXPECT_EQ(result.status, 2) << testing::PrintToString(arguments) << result.err;
    EXPECT_EQ(result.err.find("weft render: error: "), 0u) << result.err;
    EXPECT_EQ(entries(), before) << testing::PrintToString(arguments);
  }
}

// What the pictures go into is looked at before the work: there is no memory plan in the message.
TEST_F(Render, OutputsThatCannotBeMadeAreFoundFirst) {
  const std::string input = write_diffuse(path("brdf.safetensors"), 0.5, Quantity::brdf);
  const auto refused = [&](const Arguments& arguments, const std::string& name) {
    const ProcessResult result = render(arguments);
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(name), std::string::npos) << result.err;
    EXPECT_EQ(result.err.find("memory: "), std::string::npos) << result.err;
  };
  refused({input, "--size", "12", "-o", "/proc/p.png"}, "/proc/p.png");
  fs::create_directory(path("p-difference.png"));
  refused({input, "--size", "12", "--compare", input, "-o", path("p.png")}, "p-difference.png");
  EXPECT_FALSE(fs::exists(path("p.png")));
  EXPECT_FALSE(fs::exists(path("p-original.png")));
}

TEST_F(Render, ProgressCountsThePixelsOfAllFrames) {
  const std::string input = write_random(path("raw.safetensors"), 7);
  const ProcessResult one = render({input, "--size", "12", "-o", path("p.png")});
  EXPECT_EQ(one.status, 0) << one.err;
  EXPECT_NE(one.err.find("render 144 pixels in "), std::string::npos) << one.err;
  const ProcessResult frames = render({input, "--size", "12", "--turntable", "3", "-o", path("t")});
  EXPECT_EQ(frames.status, 0) << frames.err;
  EXPECT_NE(frames.err.find("render 3 frames: 432 pixels in "), std::string::npos) << frames.err;
  EXPECT_EQ(frames.err.find("images/s"), std::string::npos) << frames.err;
  // the memory of loading and of rendering, not again for every frame
  std::size_t plans = 0;
  for (std::size_t at = 0; (at = frames.err.find("memory: ", at)) != std::string::npos; ++at) {
    ++plans;
  }
  EXPECT_LE(plans, 2u) << frames.err;
}

TEST_F(Render, HelpHasExamples) {
  const ProcessResult result = render({"--help"});
  EXPECT_EQ(result.status, 0);
  for (const char* part :
       {"Examples:", "--shape", "--turntable", "--environment", "--sampling", "--compare"}) {
    EXPECT_NE(result.out.find(part), std::string::npos) << part;
  }
}

TEST_F(Render, CtrlCLeavesNothing) {
  const std::string input = write_random(path("raw.safetensors"), 8);
  const std::size_t before = entries();
  Process process(
      weft_command({"render", input, "--size", "2000", "--samples", "64", "--light-samples", "64",
                    "--exposure", "0", "--quiet", "-o", path("p.png")}));
  // it is at work once it has used some time
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  process.send_signal(SIGINT);
  const ProcessResult result = process.wait(60);
  EXPECT_EQ(result.status, 130) << result.err;
  EXPECT_EQ(entries(), before);
}

}  // namespace
}  // namespace weft::test
