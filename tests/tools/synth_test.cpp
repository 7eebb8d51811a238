#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "support/generators.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/btf/directions.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft::test {
namespace {

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<double> values_of(const std::filesystem::path& path) {
  const auto source = open_raw_btf(path);
  const BtfInfo& info = source->info();
  std::vector<std::byte> bytes(info.bytes());
  source->read(0, info.shape.images(), bytes);
  return decode_values(bytes, info.dtype);
}

TEST(Synth, RendersARawBtf) {
  const TemporaryFolder folder;
  const std::string output = (folder / "cloth.safetensors").string();
  const ProcessResult result =
      run_weft({"synth", "--size", "12x8", "--view-set", "3", "--light-set", "ubo81", "--samples",
                "2", "--dtype", "f16", "--seed", "5", "--json", "-o", output});
  ASSERT_EQ(result.status, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out);
  EXPECT_EQ(report.at("shape"), nlohmann::json({3, 81, 8, 12, 3}));
  EXPECT_EQ(report.at("file_size"), std::filesystem::file_size(output));
  EXPECT_EQ(report.at("samples"), 2);
  EXPECT_GT(report.at("rate").get<double>(), 0);

  const auto source = open_raw_btf(output);
  const BtfInfo& info = source->info();
  EXPECT_EQ(info.shape, (BtfShape{3, 81, 8, 12, 3}));
  EXPECT_EQ(info.dtype, DType::f16);
  EXPECT_EQ(info.encoding, Encoding::linear);
  EXPECT_EQ(info.quantity, Quantity::radiance);
  EXPECT_EQ(info.view_directions, even_directions(3));
  EXPECT_EQ(info.light_directions, ubo81_directions());
  EXPECT_EQ(info.channel_names, (std::vector<std::string>{"R", "G", "B"}));
  EXPECT_NE(info.source.find("--seed 5"), std::string::npos) << info.source;
  double sum = 0;
  for (const double value : values_of(output)) {
    ASSERT_TRUE(std::isfinite(value) && value >= 0);
    sum += value;
  }
  EXPECT_GT(sum, 0);
}

// Light by way of one more point adds to what is there.
TEST(Synth, BouncesAddLight) {
  const TemporaryFolder folder;
  const auto render = [&folder](const std::string& bounces) {
    const std::string output = (folder / (bounces + ".safetensors")).string();
    const ProcessResult result =
        run_weft({"synth", "--size", "8", "--view-set", "2", "--light-set", "3", "--dtype", "f32",
                  "--bounces", bounces, "--quiet", "-o", output});
    EXPECT_EQ(result.status, 0) << result.err;
    return values_of(output);
  };
  const std::vector<double> direct = render("0"), both = render("1");
  double sum = 0, added = 0;
  for (std::size_t i = 0; i < direct.size(); ++i) {
    EXPECT_GE(both[i], direct[i] * (1 - 1e-6));
    sum += direct[i];
    added += both[i] - direct[i];
  }
  EXPECT_GT(added, 0.001 * sum);
  EXPECT_LT(added, sum);
}

TEST(Synth, EncodingFollowsTheDtype) {
  const TemporaryFolder folder;
  const std::vector<std::string> common = {"synth", "--size",      "4", "--view-set",
                                           "2",     "--light-set", "2", "-o"};
  for (const std::string dtype : {"u8", "f16", "f32"}) {
    const std::string output = (folder / (dtype + ".npy")).string();
    std::vector<std::string> arguments = common;
    arguments.insert(arguments.end(), {output, "--dtype", dtype, "--quiet"});
    const ProcessResult result = run_weft(arguments);
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(result.out + result.err, "");
    EXPECT_EQ(open_raw_btf(output)->info().encoding,
              dtype == "u8" ? Encoding::srgb : Encoding::linear);
  }
}

TEST(Synth, SameOptionsGiveTheSameFileWhateverTheMemory) {
  const TemporaryFolder folder;
  const auto render = [&folder](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"synth", "--size",      "16", "--view-set",
                                          "3",     "--light-set", "20", "--samples",
                                          "2",     "--quiet",     "-o", (folder / name).string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    return bytes_of(folder / name);
  };
  const std::string whole = render("a.safetensors", {});
  EXPECT_EQ(render("b.safetensors", {"--memory", "6700KiB"}), whole);
  EXPECT_EQ(render("c.safetensors", {"--memory", "7MiB"}), whole);
  EXPECT_NE(render("d.safetensors", {"--seed", "1"}), whole);
}

TEST(Synth, ReferenceNeedsNoDevice) {
  const TemporaryFolder folder;
  const std::vector<std::string> common = {"synth", "--size",      "8", "--view-set",
                                           "3",     "--light-set", "5", "-o"};
  std::vector<std::string> arguments = common;
  arguments.insert(arguments.end(),
                   {(folder / "reference.npy").string(), "--device", "reference", "--json"});
  const std::map<std::string, std::string> no_device = {
      {"OCL_ICD_VENDORS", folder.path().string() + "/"}};
  const ProcessResult result = run_weft(arguments, no_device);
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(nlohmann::json::parse(result.out).at("device"), "reference");

  // The device makes the same picture; few samples fall to the other side of an edge.
  arguments = common;
  arguments.insert(arguments.end(), {(folder / "device.npy").string(), "--quiet"});
  ASSERT_EQ(run_weft(arguments).status, 0);
  const std::vector<double> a = values_of(folder / "reference.npy");
  const std::vector<double> b = values_of(folder / "device.npy");
  double difference = 0, sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference += std::abs(a[i] - b[i]);
    sum += a[i];
  }
  EXPECT_LT(difference, 0.01 * sum);

  // Without --device reference, that place has no device to offer.
  arguments = common;
  arguments.push_back((folder / "none.npy").string());
  EXPECT_EQ(run_weft(arguments, no_device).status, 3);
  EXPECT_FALSE(std::filesystem::exists(folder / "none.npy"));
}

std::vector<std::string> listed_materials() {
  const ProcessResult list = run_weft({"synth", "--list"});
  EXPECT_EQ(list.status, 0) << list.err;
  std::vector<std::string> names;
  std::istringstream lines(list.out);
  for (std::string line; std::getline(lines, line);) {
    names.push_back(line.substr(0, line.find(' ')));
    EXPECT_GT(line.size(), names.back().size() + 10) << "no summary: " << line;
  }
  return names;
}

TEST(Synth, RendersEveryListedMaterial) {
  const TemporaryFolder folder;
  const std::vector<std::string> names = listed_materials();
  for (const char* expected :
       {"weave", "knit", "corduroy", "leather", "hammered", "gravel", "coins", "net"}) {
    EXPECT_NE(std::find(names.begin(), names.end(), expected), names.end()) << expected;
  }
  const auto render = [&folder](const std::string& name, const std::string& material,
                                const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"synth",  "--material",
                                          material, "--size",
                                          "4",      "--view-set",
                                          "2",      "--light-set",
                                          "2",      "--samples",
                                          "1",      "--quiet",
                                          "-o",     (folder / name).string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 0) << material << ": " << result.err;
    return values_of(folder / name);
  };
  for (const std::string& name : names) {
    const std::vector<double> preset = render(name + ".npy", name, {});
    double sum = 0;
    for (const double value : preset) {
      ASSERT_TRUE(std::isfinite(value) && value >= 0) << name;
      sum += value;
    }
    EXPECT_GT(sum, 0) << name;
    // What --print prints makes the same pictures.
    const ProcessResult printed = run_weft({"synth", "--print", name});
    ASSERT_EQ(printed.status, 0) << printed.err;
    if (name != "leather" && name != "net") continue;  // one of each sort is enough, and quick
    const std::string copy = (folder / (name + "_copy.json")).string();
    std::ofstream(copy) << printed.out;
    EXPECT_EQ(render("copy.npy", copy, {}), preset) << name;
    EXPECT_NE(render("other.npy", copy, {"--material-seed", "77"}), preset) << name;
  }
}

TEST(Synth, ListsTheFieldsOfAKind) {
  const ProcessResult result = run_weft({"synth", "--fields", "leather"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("| `gloss.f90` | 0 to 1 |"), std::string::npos) << result.out;
  EXPECT_EQ(run_weft({"synth", "--fields", "brick"}).status, 2);
  EXPECT_EQ(run_weft({"synth", "--print", "brick"}).status, 2);
}

TEST(Synth, NamesWhatIsWrongWithAMaterial) {
  const TemporaryFolder folder;
  const std::string file = (folder / "mine.json").string();
  std::ofstream(file) << R"({"kind": "leather", "gloss": {"f91": 1}})";
  const ProcessResult result =
      run_weft({"synth", "--material", file, "-o", (folder / "m.npy").string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("mine.json: unknown field gloss.f91"), std::string::npos) << result.err;
  EXPECT_FALSE(std::filesystem::exists(folder / "m.npy"));
}

// Fields that are in range each, but not together.
TEST(Synth, NamesTheFileOfFieldsThatDoNotAgree) {
  const TemporaryFolder folder;
  const std::string file = (folder / "mine.json").string();
  std::ofstream(file) << R"({"kind": "net", "rows": 3})";
  const ProcessResult result =
      run_weft({"synth", "--material", file, "--size", "4", "-o", (folder / "m.npy").string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_NE(result.err.find("mine.json': net: rows is 3"), std::string::npos) << result.err;
  EXPECT_FALSE(std::filesystem::exists(folder / "m.npy"));
}

// Before the material is made, which can be seen: this one can't be made.
TEST(Synth, LooksAtTheOutputFirst) {
  const TemporaryFolder folder;
  const std::string file = (folder / "mine.json").string();
  std::ofstream(file) << R"({"kind": "net", "rows": 3})";
  std::filesystem::create_directory(folder / "m.json");
  for (const std::string& output :
       {(folder / "missing" / "m.safetensors").string(), (folder / "m.npy").string(),
        std::string("/proc/m.safetensors")}) {
    const ProcessResult result = run_weft({"synth", "--material", file, "-o", output});
    EXPECT_EQ(result.status, 2) << output;
    EXPECT_EQ(result.err.find("rows"), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("/m."), std::string::npos) << result.err;
  }
}

TEST(Synth, RefusesBadOptions) {
  const TemporaryFolder folder;
  const std::string output = (folder / "cloth.safetensors").string();
  struct Case {
    std::vector<std::string> arguments;
    std::string message;
  };
  const std::vector<Case> cases = {
      {{}, "--output"},  // missing
      {{"-o", output, "--size", "0"}, "--size: '0'"},
      {{"-o", output, "--size", "12x"}, "--size: '12x'"},
      {{"-o", output, "--size", "x12"}, "--size: 'x12'"},
      {{"-o", output, "--size", "12x8x3"}, "--size: '12x8x3'"},
      {{"-o", output, "--size", "99999"}, "--size: '99999'"},
      {{"-o", output, "--view-set", "ubo82"}, "--view-set: 'ubo82'"},
      {{"-o", output, "--light-set", "0"}, "--light-set: '0'"},
      {{"-o", output, "--samples", "0"}, "--samples"},
      {{"-o", output, "--samples", "many"}, "--samples"},
      {{"-o", output, "--bounces", "2"}, "--bounces"},
      {{"-o", output, "--dtype", "f64"}, "--dtype"},
      {{"-o", output, "--material", "brick"}, "--material"},
      {{"-o", output, "--seed", "-1"}, "--seed -1"},
      {{"-o", output, "--seed", "18446744073709551616"}, "--seed 18446744073709551616"},
      {{"-o", output, "--memory", "lots"}, "--memory"},
      {{"-o", output, "--device", "no such device"}, "no such device"},
      {{"-o", output, "surplus"}, "surplus"},
      {{"-o", (folder / "cloth.weft").string()}, "cloth.weft"},
      {{"-o", (folder / "cloth.exr").string()}, ".exr"},
      {{"-o", folder.path().string()}, "--output"},
  };
  for (const Case& wrong : cases) {
    std::vector<std::string> arguments = {"synth"};
    arguments.insert(arguments.end(), wrong.arguments.begin(), wrong.arguments.end());
    const ProcessResult result = run_weft(arguments);
    EXPECT_EQ(result.status, 2) << wrong.message << "\n" << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_NE(result.err.find(wrong.message), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(output));
  }
  // A folder that is not there is a failure of the run or bad input, and leaves nothing.
  const ProcessResult result =
      run_weft({"synth", "--size", "4", "--view-set", "1", "--light-set", "1", "-o",
                (folder / "missing" / "cloth.safetensors").string()});
  EXPECT_TRUE(result.status == 2 || result.status == 4) << result.status;
  EXPECT_NE(result.err.find("missing"), std::string::npos) << result.err;
}

TEST(Synth, MemoryHoldsTheSurfaceToo) {
  const TemporaryFolder folder;
  for (const std::string material : {"weave", "knit"}) {
    const std::string output = (folder / (material + ".safetensors")).string();
    const std::vector<std::string> device = {"--device", "reference"};
    for (const bool reference : {false, true}) {
      std::vector<std::string> arguments = {"synth", "--material",  material, "--size",
                                            "8",     "--view-set",  "1",      "-o",
                                            output,  "--light-set", "1",      "--memory"};
      arguments.emplace_back("1MiB");
      if (reference) arguments.insert(arguments.end(), device.begin(), device.end());
      const ProcessResult result = run_weft(arguments);
      EXPECT_EQ(result.status, 2) << result.err;
      EXPECT_NE(result.err.find("surface"), std::string::npos) << result.err;
      EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
    }
  }
}

TEST(Synth, StopsCleanlyWhenInterrupted) {
  const TemporaryFolder folder;
  const std::string output = (folder / "long.safetensors").string();
  Process process(weft_command({"synth", "--size", "64", "--samples", "256", "-o", output}));
  // Wait for the half-made file, so that the signal meets the job at work.
  for (int i = 0; i < 600 && std::filesystem::is_empty(folder.path()); ++i) {
    if (!process.running()) break;
    usleep(50000);
  }
  process.send_signal(SIGINT);
  const ProcessResult result = process.wait();
  EXPECT_EQ(result.status, 130) << result.err;
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace weft::test
