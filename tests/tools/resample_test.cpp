#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/file_bytes.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/io/merl.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

std::vector<double> values_of(const std::filesystem::path& path) {
  const auto source = open_raw_btf(path);
  std::vector<std::byte> bytes(source->info().bytes());
  source->read(0, source->info().shape.images(), bytes);
  return decode_values(bytes, source->info().dtype);
}

void write_raw(const std::filesystem::path& path, const BtfInfo& info,
               std::span<const std::byte> bytes) {
  const auto sink = create_raw_btf(path, info);
  sink->write(0, info.shape.images(), bytes);
  sink->finish();
}

std::filesystem::path write_cloth(const TemporaryFolder& folder, DType dtype = DType::f16) {
  const auto data = random_source({7, 9, 6, 5, 3}, dtype, 4);
  BtfInfo info = data->info();
  info.mask.assign(7 * 30, 1);
  info.mask[31] = 0;
  write_raw(folder / "cloth.safetensors", info, data->bytes());
  return folder / "cloth.safetensors";
}

nlohmann::json run_for_report(const std::string& subcommand, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), subcommand);
  arguments.push_back("--json");
  const ProcessResult result = run_weft(arguments);
  EXPECT_EQ(result.status, 0) << result.err;
  return nlohmann::json::parse(result.out);
}

void expect_refused(std::vector<std::string> arguments, const std::string& part) {
  arguments.insert(arguments.begin(), "resample");
  const ProcessResult result = run_weft(arguments);
  EXPECT_EQ(result.status, 2) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
}

TEST(Resample, DeviceAndReferenceGiveTheSameInOtherDirections) {
  const TemporaryFolder folder;
  const std::string cloth = write_cloth(folder, DType::f32);
  std::vector<std::vector<double>> values;
  for (const std::string device : {"auto", "reference"}) {
    const std::string out = folder / (device + ".safetensors");
    const nlohmann::json report = run_for_report(
        "resample",
        {cloth, "--view-set", "4", "--light-set", "grid:3x4:60", "--device", device, "-o", out});
    EXPECT_EQ(report.at("shape"), nlohmann::json({4, 9, 6, 5, 3}));
    EXPECT_EQ(report.at("mask"), true);
    EXPECT_EQ(report.at("passes"), 1);
    EXPECT_EQ(open_raw_btf(out)->info().view_directions, even_directions(4));
    values.push_back(values_of(out));
  }
  // two sums of at most 9 values below 1 with weights below 2, in float
  EXPECT_TRUE(all_near(values[0], values[1], 2 * 9 * 4 * gamma(24, float_roundoff)));
}

TEST(Resample, OneSetAloneKeepsTheOther) {
  const TemporaryFolder folder;
  const std::string cloth = write_cloth(folder);
  const std::string out = folder / "lights.npy";
  const nlohmann::json report = run_for_report(
      "resample", {cloth, "--light-set", cloth, "--views", "2,0", "--dtype", "f32", "-o", out});
  EXPECT_EQ(report.at("shape"), nlohmann::json({2, 9, 6, 5, 3}));
  // the same directions: the same values
  const std::vector<double> all = values_of(cloth), part = values_of(out);
  const std::size_t view = 9 * 6 * 5 * 3;
  EXPECT_TRUE(std::equal(part.begin(), part.begin() + view, all.begin() + 2 * view));
  EXPECT_TRUE(std::equal(part.begin() + view, part.end(), all.begin()));
}

TEST(Resample, OnionSlicesArePairs) {
  const TemporaryFolder folder;
  const std::string cloth = write_cloth(folder);
  const std::string out = folder / "slices.safetensors";
  const nlohmann::json report =
      run_for_report("resample", {cloth, "--onion", "3,5,2,4", "--memory", "4MiB", "-o", out});
  EXPECT_EQ(report.at("shape"), nlohmann::json({4 * 2 * 3 * 5, 1, 6, 5, 3}));
  EXPECT_EQ(report.at("layout"), "paired");
  for (const double value : values_of(out)) EXPECT_GE(value, 0);
}

TEST(Resample, MerlThereAndBack) {
  const TemporaryFolder folder;
  // A diffuse texel and a glossy one as radiance.
  BtfInfo info = make_info({81, 81, 1, 2, 3});
  info.view_directions = ubo81_directions();
  info.light_directions = ubo81_directions();
  std::vector<double> values;
  for (const Direction& v : info.view_directions) {
    for (const Direction& l : info.light_directions) {
      const double length = std::hypot(v[0] + l[0], v[1] + l[1], v[2] + l[2]);
      const double glossy = 0.1 + std::pow((v[2] + l[2]) / length, 8);
      for (const double f : {0.5, 0.25, 0.125}) values.push_back(f * l[2]);
      for (const double f : {1.0, 0.5, 2.0}) values.push_back(f * glossy * l[2]);
    }
  }
  write_raw(folder / "two.safetensors", info, encode_values(values, DType::f32));
  for (const std::string texel : {"0", "1"}) {
    const nlohmann::json report =
        run_for_report("resample", {folder / "two.safetensors", "--region", texel + ",0,1x1", "-o",
                                    folder / ("t" + texel + ".binary")});
    EXPECT_EQ(report.at("kind"), "merl");
    EXPECT_EQ(report.at("file_size"), 34992012);
  }
  const nlohmann::json report =
      run_for_report("import", {folder / "t0.binary", folder / "t1.binary", "--view-set", "30",
                                "--light-set", "40", "-o", folder / "row.safetensors"});
  EXPECT_EQ(report.at("kind"), "merl");
  EXPECT_EQ(report.at("quantity"), "brdf");
  EXPECT_EQ(report.at("shape"), nlohmann::json({30, 40, 1, 2, 3}));
  const std::vector<double> row = values_of(folder / "row.safetensors");
  const std::vector<Direction> views = even_directions(30), lights = even_directions(40);
  for (std::size_t v = 0; v < 30; ++v) {
    for (std::size_t l = 0; l < 40; ++l) {
      const float* a = views[v].data();
      const float* b = lights[l].data();
      const double* texel = row.data() + (v * 40 + l) * 6;
      // Triangles keep a cosine but where chords are under the sphere: (1 - cos 10 degrees) of it.
      EXPECT_NEAR(texel[0], 0.5, 0.02);
      EXPECT_NEAR(texel[2], 0.125, 0.005);
      const double length = std::hypot(a[0] + b[0], a[1] + b[1], a[2] + b[2]);
      const double glossy = 0.1 + std::pow((a[2] + b[2]) / length, 8);
      // Triangles of directions d = 15 degrees apart err by up to d^2 / 2 |f''| each, and |f''| <=
      // 2 where the half vector moves half as fast as either; the cosine errs as above.
      EXPECT_NEAR(texel[3], glossy, 0.2);
    }
  }
  // A folder of them is the same row.
  std::filesystem::create_directory(folder / "data");
  std::filesystem::rename(folder / "t0.binary", folder / "data/t0.binary");
  std::filesystem::rename(folder / "t1.binary", folder / "data/t1.binary");
  run_for_report("import", {folder / "data", "--kind", "merl", "--view-set", "30", "--light-set",
                            "40", "-o", folder / "again.safetensors"});
  EXPECT_EQ(values_of(folder / "again.safetensors"), row);
}

TEST(Resample, BadRequestsAreRefusedAndLeaveNothing) {
  const TemporaryFolder folder;
  const std::string cloth = write_cloth(folder);
  const std::string out = folder / "out.safetensors";
  expect_refused({cloth, "-o", out}, "new directions are needed");
  expect_refused({cloth, "--view-set", "4"}, "--output");
  expect_refused({cloth, "--view-set", "4", "-o", folder / "out.weft"}, "a raw BTF ends in");
  expect_refused({cloth, "--view-set", "4", "-o", folder / "absent/out.npy"}, "absent");
  expect_refused({folder / "absent.safetensors", "--view-set", "4", "-o", out}, "absent");
  expect_refused({cloth, "--view-set", "none", "-o", out}, "--view-set: 'none'");
  expect_refused({cloth, "--light-set", "grid:4", "-o", out}, "--light-set: 'grid:4'");
  expect_refused({cloth, "--onion", "11,11,7", "-o", out}, "--onion: '11,11,7'");
  expect_refused({cloth, "--onion", "3,3,2,2", "--view-set", "4", "-o", out}, "--onion");
  expect_refused({cloth, "--view-set", "4", "--memory", "64KiB", "-o", out}, "memory");
  expect_refused({cloth, "--view-set", "4", "--views", "9", "-o", out}, "--views: '9'");
  expect_refused({cloth, "-o", folder / "x.binary"}, "--region X,Y,1x1");
  expect_refused({cloth, "--view-set", "4", "-o", folder / "x.binary"}, "--view-set");
  write_bytes(folder / "below.json", "[[0, 0.6, -0.8]]");
  expect_refused({cloth, "--light-set", folder / "below.json", "-o", out}, "below the horizon");
  std::filesystem::remove(folder / "below.json");
  EXPECT_EQ(count_files(folder.path()), 1u);
}

TEST(Resample, DirectionsOfAnImportAreOfBrdfs) {
  const TemporaryFolder folder;
  const std::string cloth = write_cloth(folder), out = folder / "out.safetensors";
  const auto refused = [&](std::vector<std::string> arguments, const std::string& part) {
    arguments.insert(arguments.begin(), "import");
    arguments.insert(arguments.end(), {"-o", out});
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
  };
  refused({cloth, "--light-set", "4"}, "--light-set");
  refused({cloth, cloth}, "several inputs");
  write_bytes(folder / "short.binary", "no BRDF");
  refused({folder / "short.binary"}, "short.binary: 7 bytes");
  refused({folder.path(), "--kind", "merl", "--view-set", "none"}, "--view-set: 'none'");
  std::filesystem::remove(folder / "short.binary");
  refused({folder.path(), "--kind", "merl"}, "no files named *.binary");
  EXPECT_EQ(count_files(folder.path()), 1u);
}

TEST(Resample, HelpNamesTheOptions) {
  const ProcessResult result = run_weft({"resample", "--help"});
  EXPECT_EQ(result.status, 0);
  for (const char* word : {"--view-set", "--light-set", "--onion", "--dtype", "--device",
                           "--memory", "grid:", ".binary", "Examples:"}) {
    EXPECT_NE(result.out.find(word), std::string::npos) << word;
  }
}

}  // namespace
}  // namespace weft::test
