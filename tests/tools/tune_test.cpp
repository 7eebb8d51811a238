// weft tune as a process, the trials of its kernels, and what databases do to other subcommands. No
// time is a condition.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>

#include "support/shared_device.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "tune/trial.hpp"
#include "weft/device/tuning_file.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// A database with decode_pca's values for the device "auto".
TuningResult decode_pca_result(std::size_t panels) {
  return {fingerprint(shared_device().limits()),
          "decode_pca",
          {{"PANELS", panels}, {"IMAGES", 16}},
          "64 x 16384 x 3, rank 64",
          1.0,
          0.5};
}

TEST(TuneTrials, EveryTunableKernelHasOne) {
  std::set<std::string> kernels;
  for (const Trial& trial : all_trials()) {
    EXPECT_TRUE(kernels.insert(trial.kernel->name).second) << trial.kernel->name;
    EXPECT_TRUE(trial.timed.prepare) << trial.kernel->name << " has nothing to be timed by";
  }
  for (const TunableKernel* kernel : tunable_kernels()) {
    EXPECT_TRUE(kernels.contains(kernel->name)) << kernel->name;
  }
}

// Legal values give right results: all macros at their defaults, their least and their largest.
TEST(TuneTrials, ExtremesOfLegalValuesAreRight) {
  Device device("auto");
  for (const Trial& trial : all_trials()) {
    TuneValues least, largest;
    for (const Tunable& macro : trial.kernel->macros) {
      least.push_back(*macro.legal.begin());
      largest.push_back(*(macro.legal.end() - 1));
    }
    const TuneValues standard = device.tuning().values(*trial.kernel);
    const Check check = trial.prepare_check(device);
    for (const TuneValues& values : {standard, least, largest}) {
      if (!refusal(*trial.kernel, values, device.limits()).empty()) continue;
      SCOPED_TRACE(std::string(trial.kernel->name) + ": " + format_values(*trial.kernel, values));
      device.tune(*trial.kernel, values, "test");
      EXPECT_EQ(check(), "");
    }
    device.tune(*trial.kernel, standard, "test");
  }
}

TEST(TuneTrials, DifferencesAreFound) {
  const auto tolerance = [](std::size_t) { return 0.5; };
  EXPECT_EQ(difference(std::vector<float>{1, 2}, {1.5, 1.5}, tolerance), "");
  EXPECT_NE(difference(std::vector<float>{1, 3}, {1, 2}, tolerance).find("value 1 is 3"),
            std::string::npos);
  EXPECT_NE(difference(std::vector<float>{1, NAN}, {1, 2}, tolerance), "");
}

TEST(Tune, WritesWhatItFindsAndReportsIt) {
  const TemporaryFolder folder;
  const std::string file = (folder / "new" / "tuning.json").string();
  // values of an earlier search, which are renewed or replaced by the default
  save_tuning(file, {decode_pca_result(1)});
  const ProcessResult result = run_weft(
      {"tune", "--kernel", "decode_pca", "--budget", "2", "--json"}, {{"WEFT_TUNING", file}});
  ASSERT_EQ(result.status, 0) << result.err;
  const json report = json::parse(result.out);
  EXPECT_EQ(report.at("file"), file);
  ASSERT_EQ(report.at("kernels").size(), 1U);
  const json& row = report.at("kernels").at(0);
  EXPECT_EQ(row.at("kernel"), "decode_pca");
  EXPECT_GE(row.at("tried").get<int>(), 2);
  EXPECT_EQ(row.at("rejected"), 0);
  EXPECT_GT(row.at("default_ms").get<double>(), 0);
  EXPECT_EQ(row.at("written"), true);

  // the database has the best values, and other subcommands use them
  const json root = json::parse(text_of(file));
  ASSERT_EQ(root.at("entries").size(), 1U);
  const json& values = root.at("entries").at(0).at("values");
  std::string best;
  for (const char* macro : {"PANELS", "IMAGES"}) {
    best += (best.empty() ? "" : " ") + std::string(macro) + "=" + values.at(macro).dump();
  }
  EXPECT_EQ(row.at("best_values"), best);
  const ProcessResult list =
      run_weft({"tune", "--list", "--kernel", "decode_pca", "--json"}, {{"WEFT_TUNING", file}});
  ASSERT_EQ(list.status, 0) << list.err;
  const json macros = json::parse(list.out).at("macros");
  ASSERT_EQ(macros.size(), 2U);
  for (const json& macro : macros) {
    EXPECT_EQ(macro.at("source"), file);
    EXPECT_EQ(macro.at("value"), values.at(macro.at("macro").get<std::string>()));
  }
}

TEST(Tune, NothingIsWrittenWithoutTimeToCompare) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "tuning.json";
  const ProcessResult result = run_weft(
      {"tune", "--kernel", "scan_tile", "--budget", "0", "--output", file.string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json row = json::parse(result.out).at("kernels").at(0);
  EXPECT_EQ(row.at("tried"), 1);
  EXPECT_EQ(row.at("outcome"), "default kept");
  EXPECT_EQ(row.at("written"), false);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Tune, AnInterruptionLeavesTheDatabaseAsItWas) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "tuning.json";
  save_tuning(file, {decode_pca_result(2)});
  const std::string before = text_of(file);
  Process process(weft_command({"tune", "--kernel", "gemm", "--budget", "200"}),
                  {{"WEFT_TUNING", file.string()}});
  std::this_thread::sleep_for(std::chrono::seconds(2));
  process.send_signal(SIGINT);
  const ProcessResult result = process.wait(60);
  EXPECT_EQ(result.status, 130) << result.err;
  EXPECT_EQ(text_of(file), before);
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    (void)entry;
    ++files;
  }
  EXPECT_EQ(files, 1U);
}

TEST(Tune, BadUsageIsNamed) {
  const TemporaryFolder folder;
  std::ofstream(folder / "notes.txt") << "not a database";
  const struct {
    std::vector<std::string> arguments;
    std::vector<std::string> parts;
  } cases[] = {
      {{"--kernel", "gem"}, {"gem", "decode_pca"}},
      {{"--budget", "-1"}, {"--budget"}},
      {{"--budget", "soon"}, {"--budget"}},
      {{"--seed", "18446744073709551616"}, {"--seed 18446744073709551616"}},
      {{"--device", "reference"}, {"reference"}},
      {{"--output", (folder / "notes.txt").string()}, {"notes.txt"}},
      {{"--output", folder.path().string()}, {folder.path().string()}},
      {{}, {"--output"}},  // the environment of the tests names no database
  };
  for (const auto& [arguments, parts] : cases) {
    std::vector<std::string> command{"tune"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const ProcessResult result = run_weft(command, {{"WEFT_TUNING", ""}});
    EXPECT_EQ(result.status, 2) << result.err;
    for (const std::string& part : parts) {
      EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
    }
  }
  EXPECT_EQ(text_of(folder / "notes.txt"), "not a database");
}

TEST(TuningDatabaseInUse, BrokenAndForeignEntriesAreWarnedOfUnlessQuiet) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "tuning.json";
  TuningResult foreign = decode_pca_result(8);
  foreign.device[3] = "A device of elsewhere";
  TuningResult broken = decode_pca_result(3);
  TuningResult good = decode_pca_result(8);
  good.kernel = "scan_tile";
  good.values = {{"CHUNK", 256}};
  save_tuning(file, {foreign, broken, good});
  const std::vector<std::string> command{"bench",    "--filter", "scan_tile",
                                         "--repeat", "1",        "--json"};
  const ProcessResult result = run_weft(command, {{"WEFT_TUNING", file.string()}});
  ASSERT_EQ(result.status, 0) << result.err;
  for (const char* part : {"warning: ", "tuning.json: entry 0 (decode_pca) is ignored",
                           "A device of elsewhere", "entry 1 (decode_pca)", "PANELS is 3"}) {
    EXPECT_NE(result.err.find(part), std::string::npos) << part << " in\n" << result.err;
  }
  const json tuning = json::parse(result.out).at("tuning").at("scan_tile");
  EXPECT_EQ(tuning.at("CHUNK"), 256);
  EXPECT_EQ(tuning.at("source"), file.string());

  const std::string missing = (folder / "missing.json").string();
  const std::vector<std::string> list{"tune", "--list", "--kernel", "scan_tile"};
  const ProcessResult unread = run_weft(list, {{"WEFT_TUNING", missing}});
  EXPECT_EQ(unread.status, 0);
  EXPECT_NE(unread.err.find("warning: WEFT_TUNING=" + missing), std::string::npos) << unread.err;
  EXPECT_EQ(run_weft(list, {{"WEFT_TUNING", ""}}).err, "");

  std::vector<std::string> quiet = command;
  quiet.push_back("--quiet");
  const ProcessResult silent = run_weft(quiet, {{"WEFT_TUNING", file.string()}});
  EXPECT_EQ(silent.status, 0);
  EXPECT_EQ(silent.err.find("warning: "), std::string::npos) << silent.err;
}

}  // namespace
}  // namespace weft::test
