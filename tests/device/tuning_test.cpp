// Tables of tunable macros, and the values that databases give them on a device.
#include "weft/device/tuning.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "device/tuning_samples.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/mutate.hpp"
#include "weft/device/device.hpp"
#include "weft/device/tuning_file.hpp"

namespace weft::test {
namespace {

using Values = std::vector<std::size_t>;

bool has(const std::string& text, std::string_view part) {
  return text.find(part) != std::string::npos;
}

// One warning, which names the file, the entry and the reason.
void expect_one_warning(const Tuning& tuning, std::initializer_list<std::string_view> parts) {
  ASSERT_EQ(tuning.warnings().size(), 1U);
  for (const std::string_view part : parts) {
    EXPECT_TRUE(has(tuning.warnings()[0], part))
        << "\"" << tuning.warnings()[0] << "\" does not name \"" << part << "\"";
  }
}

TEST(Tunables, TablesAreSound) {
  std::set<std::string> kernels;
  for (const TunableKernel* kernel : tunable_kernels()) {
    EXPECT_TRUE(kernels.insert(kernel->name).second) << kernel->name << " is listed twice";
    EXPECT_EQ(find_tunable(kernel->name), kernel);
    EXPECT_FALSE(kernel->macros.empty()) << kernel->name;
    std::set<std::string> macros;
    for (const Tunable& macro : kernel->macros) {
      SCOPED_TRACE(std::string(kernel->name) + ", " + macro.macro);
      EXPECT_TRUE(macros.insert(macro.macro).second) << "twice";
      EXPECT_TRUE(macro.legal.contains(macro.standard)) << macro.standard;
      EXPECT_TRUE(std::is_sorted(macro.legal.begin(), macro.legal.end()));
      EXPECT_FALSE(std::string(macro.meaning).empty());
    }
  }
  EXPECT_EQ(find_tunable("no such kernel"), nullptr);
}

TEST(Tunables, DefaultsSuitEveryDevice) {
  DeviceLimits small = sample_limits();
  small.max_work_group = 256;
  small.local_memory = 32768;  // the least that OpenCL 1.2 asks for
  const Tuning tuning;
  for (const TunableKernel* kernel : tunable_kernels()) {
    EXPECT_EQ(refusal(*kernel, tuning.values(*kernel), small), "") << kernel->name;
    EXPECT_EQ(tuning.source(*kernel), "default");
  }
}

TEST(Tunables, AMacroThatIsNoneIsARunTimeError) {
  const Tuning tuning;
  expect_error(ErrorKind::runtime, {"gemm", "DEPTH"},
               [&] { (void)tuning.value(tunables::gemm, "DEPTH"); });
}

TEST(ShippedTuning, IsSoundAndServesPocl) {
  DeviceLimits pocl = sample_limits();
  pocl.platform = "Portable Computing Language";
  const Tuning tuning(pocl, {}, shipped_tuning(), {});
  EXPECT_TRUE(tuning.warnings().empty()) << tuning.warnings().front();
  for (const TunableKernel* kernel : tunable_kernels()) {
    EXPECT_EQ(tuning.source(*kernel), "shipped") << kernel->name;
  }
  // a GPU of another maker has the defaults, and no warning
  pocl.platform = "Another Platform";
  pocl.is_cpu = false;
  const Tuning other(pocl, {}, shipped_tuning(), {});
  EXPECT_TRUE(other.warnings().empty()) << other.warnings().front();
  for (const TunableKernel* kernel : tunable_kernels()) {
    EXPECT_EQ(other.source(*kernel), "default") << kernel->name;
  }
}

TEST(Tuning, UsersEntriesWinOverShippedOnesAndDefaults) {
  const DeviceLimits limits = sample_limits();
  const TuningDatabase shipped = sample_database("shipped", {{{"values", {{"PANELS", 2}}}}});
  const Tuning from_shipped(limits, {}, shipped, {});
  EXPECT_EQ(from_shipped.values(tunables::decode_pca), (Values{2, 16}));
  EXPECT_EQ(from_shipped.source(tunables::decode_pca), "shipped");

  // what an entry leaves out is the default, not the shipped value
  const TuningDatabase user = sample_database("mine.json", {{{"values", {{"IMAGES", 64}}}}});
  const Tuning both(limits, {}, shipped, user);
  EXPECT_EQ(both.values(tunables::decode_pca), (Values{4, 64}));
  EXPECT_EQ(both.source(tunables::decode_pca), "mine.json");
  EXPECT_EQ(both.options(tunables::decode_pca), "-DPANELS=4 -DIMAGES=64");
  EXPECT_EQ(both.value(tunables::decode_pca, "IMAGES"), 64U);
  EXPECT_EQ(both.source(tunables::gemm), "default");
  EXPECT_TRUE(both.warnings().empty());
  EXPECT_EQ(both.used(), std::set<std::string>{"decode_pca"});
}

TEST(Tuning, AnEntryServesItsOwnDeviceOnly) {
  const DeviceLimits limits = sample_limits();
  for (const char* field : fingerprint_fields) {
    SCOPED_TRACE(field);
    Json entry = sample_entry();
    entry["device"][field] = "else";
    const TuningDatabase user = sample_database("mine.json", {entry});
    const Tuning tuning(limits, {}, {}, user);
    EXPECT_EQ(tuning.source(tunables::decode_pca), "default");
    expect_one_warning(tuning, {"mine.json", "entry 0", "decode_pca", "another device", field,
                                "\"else\"", sample_entry()["device"][field].get<std::string>()});
    // nothing is wrong with it if the machine has that device as well
    DeviceFingerprint other;
    for (std::size_t i = 0; i < other.size(); ++i) {
      other[i] = entry["device"][fingerprint_fields[i]].get<std::string>();
    }
    const Tuning quiet(limits, std::span(&other, 1), {}, user);
    EXPECT_EQ(quiet.source(tunables::decode_pca), "default");
    EXPECT_TRUE(quiet.warnings().empty());

    // the user's entries name every text
    entry["device"].erase(field);
    const Tuning missing(limits, {}, {}, sample_database("mine.json", {entry}));
    EXPECT_EQ(missing.source(tunables::decode_pca), "default");
    expect_one_warning(missing, {"mine.json", "entry 0", "decode_pca", field});
  }
}

TEST(Tuning, ABrokenEntryIsLeftAsideWhole) {
  const DeviceLimits limits = sample_limits();
  struct Broken {
    Json patch;
    std::string_view reason;
  };
  const Broken cases[] = {
      {{{"kernel", "decode_everything"}}, "no kernel of this name"},
      {{{"kernel", 7}}, "\"kernel\" is not a string"},
      {{{"values", {{"IMAGES", 32}, {"NOTHING", 1}}}}, "no tunable macro \"NOTHING\""},
      {{{"values", {{"IMAGES", 33}}}}, "IMAGES is 33; legal values are 4, 8, 16, 32, 64"},
      {{{"values", {{"IMAGES", 0}}}}, "IMAGES is 0"},
      {{{"values", {{"IMAGES", 18446744073709551615U}}}}, "IMAGES is 18446744073709551615"},
      {{{"values", {{"IMAGES", -32}}}}, "not an unsigned whole number"},
      {{{"values", {{"IMAGES", 32.0}}}}, "not an unsigned whole number"},
      {{{"values", {{"IMAGES", "32"}}}}, "not an unsigned whole number"},
      {{{"values", {{"IMAGES", true}}}}, "not an unsigned whole number"},
      {{{"values", {{"IMAGES", nullptr}}}}, "not an unsigned whole number"},
      {{{"values", {1, 2}}}, "\"values\" is not an object"},
      {{{"device", "cpu"}}, "\"device\" is not an object"},
      {{{"device", {{"kind", "cpu"}, {"platform", 1}}}}, "\"platform\" is not a string"},
  };
  for (const Broken& broken : cases) {
    SCOPED_TRACE(broken.patch.dump());
    // the next entry is as good as ever
    const Json good = {{"kernel", "scan_tile"}, {"values", {{"CHUNK", 256}}}};
    const Tuning tuning(limits, {}, {}, sample_database("mine.json", {broken.patch, good}));
    EXPECT_EQ(tuning.values(tunables::decode_pca), (Values{4, 16}));
    EXPECT_EQ(tuning.values(tunables::scan_tile), Values{256});
    expect_one_warning(tuning, {"mine.json", "entry 0", broken.reason});
  }
}

TEST(Tuning, ASecondEntryForTheSameKernelIsIgnored) {
  const Tuning tuning(sample_limits(), {}, {},
                      sample_database("mine.json", {{{"values", {{"IMAGES", 64}}}},
                                                    {{"values", {{"IMAGES", 32}}}}}));
  EXPECT_EQ(tuning.values(tunables::decode_pca), (Values{4, 64}));
  expect_one_warning(tuning, {"mine.json", "entry 1", "decode_pca", "earlier entry"});
}

TEST(Tuning, ABrokenDatabaseIsIgnoredWhole) {
  const std::string entries = sample_database("", {Json::object()}).text;
  std::string other_version = entries;
  other_version.replace(other_version.find("\"version\":1}"), 12, "\"version\":2}");
  const std::pair<std::string, std::string_view> cases[] = {
      {"{", "mine.json"},
      {"[]", "\"format\""},
      {"{}", "\"format\""},
      {"null", "\"format\""},
      {R"({"format": "weft tuning"})", "\"version\" is missing"},
      {R"({"format": "weft tuning", "version": "1", "entries": []})", "\"version\""},
      {R"({"format": "weft tuning", "version": 1})", "\"entries\""},
      {R"({"format": "weft tuning", "version": 1, "entries": {}})", "\"entries\""},
      {R"({"format": "weft model", "version": 1, "entries": []})", "\"format\""},
      {other_version, "\"version\" is 2, where 1 is known"},
      {entries + "x", "mine.json"},
      {std::string(100000, '['), "mine.json"},
  };
  for (const auto& [text, reason] : cases) {
    SCOPED_TRACE(text.substr(0, 80));
    const Tuning tuning(sample_limits(), {}, {}, {"mine.json", text});
    EXPECT_EQ(tuning.source(tunables::decode_pca), "default");
    expect_one_warning(tuning, {"mine.json", "the whole file is ignored", reason});
  }
}

TEST(Tuning, ManyBrokenEntriesAreCounted) {
  std::vector<Json> entries(1000, Json{{"kernel", "none\n\x1b[31m"}});
  const Tuning tuning(sample_limits(), {}, {}, sample_database("mine.json", entries));
  ASSERT_EQ(tuning.warnings().size(), 17U);
  EXPECT_TRUE(has(tuning.warnings().back(), "984 more entries")) << tuning.warnings().back();
  for (const std::string& warning : tuning.warnings()) {
    EXPECT_TRUE(std::all_of(warning.begin(), warning.end(), [](char c) { return c >= ' '; }))
        << "control characters in a warning";
  }
}

TEST(Tuning, DamagedDatabasesGiveLegalValuesOrWarnings) {
  const std::string whole =
      sample_database("mine.json", {{{"values", {{"IMAGES", 64}, {"PANELS", 8}}}},
                                    {{"kernel", "scan_tile"}, {"values", {{"CHUNK", 256}}}}})
          .text;
  Random random(5);
  const DeviceLimits limits = sample_limits();
  for (int i = 0; i < 4000; ++i) {
    const std::string text = mutate(whole, whole.size(), random);
    const Tuning tuning(limits, {}, {}, {"mine.json", text});
    for (const TunableKernel* kernel : tunable_kernels()) {
      ASSERT_EQ(refusal(*kernel, tuning.values(*kernel), limits), "") << text;
    }
  }
}

TEST(DeviceTuning, ValuesAreCheckedAndUsed) {
  Device device("auto");
  const Values values{8, 32};
  device.tune(tunables::decode_pca, values, "trial");
  EXPECT_EQ(device.tuning().values(tunables::decode_pca), values);
  EXPECT_EQ(device.tuning().source(tunables::decode_pca), "trial");
  EXPECT_EQ(device.parameter(tunables::decode_pca, "PANELS"), 8U);
  EXPECT_EQ(device.tuned_options(tunables::decode_pca), "-DPANELS=8 -DIMAGES=32");
  expect_error(ErrorKind::input, {"decode_pca", "PANELS is 3"}, [&] {
    device.tune(tunables::decode_pca, {3, 32}, "trial");
  });
  EXPECT_EQ(device.tuning().values(tunables::decode_pca), values);
}

}  // namespace
}  // namespace weft::test
