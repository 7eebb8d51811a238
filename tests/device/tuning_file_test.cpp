// Where a user's tuning database lies, how it is read, and how entries are put into it.
#include "weft/device/tuning_file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "device/tuning_samples.hpp"
#include "support/expect_error.hpp"
#include "support/temporary_folder.hpp"

namespace weft::test {
namespace {

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// Sets variables of the environment, or removes them, until its end.
class Environment {
 public:
  explicit Environment(const std::map<std::string, std::optional<std::string>>& variables) {
    for (const auto& [name, value] : variables) {
      const char* before = std::getenv(name.c_str());
      before_[name] = before ? std::optional<std::string>(before) : std::nullopt;
      set(name, value);
    }
  }
  ~Environment() {
    for (const auto& [name, value] : before_) set(name, value);
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;

 private:
  static void set(const std::string& name, const std::optional<std::string>& value) {
    if (value) {
      setenv(name.c_str(), value->c_str(), 1);
    } else {
      unsetenv(name.c_str());
    }
  }
  std::map<std::string, std::optional<std::string>> before_;
};

TuningResult sample_result() {
  return {fingerprint(sample_limits()),
          "decode_pca",
          {{"PANELS", 8}, {"IMAGES", 32}},
          "64 x 16384",
          0.5,
          0.25};
}

TEST(UserTuningFile, FollowsTheEnvironment) {
  {
    const Environment none({{"WEFT_TUNING", std::string()}});
    EXPECT_TRUE(user_tuning_file().empty());
  }
  {
    const Environment named({{"WEFT_TUNING", "/somewhere/t.json"}, {"XDG_CONFIG_HOME", "/config"}});
    EXPECT_EQ(user_tuning_file(), "/somewhere/t.json");
  }
  {
    const Environment config(
        {{"WEFT_TUNING", std::nullopt}, {"XDG_CONFIG_HOME", "/config"}, {"HOME", "/home/me"}});
    EXPECT_EQ(user_tuning_file(), "/config/weft/tuning.json");
  }
  {
    const Environment home(
        {{"WEFT_TUNING", std::nullopt}, {"XDG_CONFIG_HOME", ""}, {"HOME", "/home/me"}});
    EXPECT_EQ(user_tuning_file(), "/home/me/.config/weft/tuning.json");
  }
  {
    const Environment nothing(
        {{"WEFT_TUNING", std::nullopt}, {"XDG_CONFIG_HOME", std::nullopt}, {"HOME", std::nullopt}});
    EXPECT_TRUE(user_tuning_file().empty());
  }
}

TEST(UserTuningFile, ServesADevice) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "tuning.json";
  TuningResult result = sample_result();
  result.device = fingerprint(Device("auto").limits());
  save_tuning(file, {result});
  const Environment named({{"WEFT_TUNING", file.string()}});
  const Device device("auto");
  EXPECT_TRUE(device.tuning().warnings().empty());
  EXPECT_EQ(device.parameter(tunables::decode_pca, "PANELS"), 8U);
  EXPECT_EQ(device.tuning().source(tunables::decode_pca), file.string());
}

TEST(ReadTuning, AnAbsentFileIsNoDatabase) {
  const TemporaryFolder folder;
  std::vector<std::string> warnings;
  EXPECT_TRUE(read_tuning(folder / "none.json", warnings).text.empty());
  EXPECT_TRUE(read_tuning({}, warnings).text.empty());
  EXPECT_TRUE(warnings.empty());
}

TEST(ReadTuning, AnAbsentFileThatTheEnvironmentNamesIsAWarning) {
  const TemporaryFolder folder;
  const std::string missing = (folder / "none.json").string();
  std::vector<std::string> warnings;
  {
    const Environment named({{"WEFT_TUNING", missing}});
    EXPECT_TRUE(read_user_tuning(warnings).text.empty());
  }
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_NE(warnings[0].find("WEFT_TUNING=" + missing), std::string::npos) << warnings[0];
  {
    const Environment nothing({{"WEFT_TUNING", std::string()}});
    EXPECT_TRUE(read_user_tuning(warnings).text.empty());
  }
  {
    const Environment config({{"WEFT_TUNING", std::nullopt}, {"XDG_CONFIG_HOME", missing}});
    EXPECT_TRUE(read_user_tuning(warnings).text.empty());
  }
  EXPECT_EQ(warnings.size(), 1U);
}

TEST(ReadTuning, WhatCannotBeReadIsAWarning) {
  const TemporaryFolder folder;
  write_text(folder / "large.json", std::string(largest_tuning_file + 1, ' '));
  write_text(folder / "empty.json", "");
  ASSERT_EQ(mkfifo((folder / "pipe.json").c_str(), 0600), 0);
  const std::pair<std::filesystem::path, std::string_view> cases[] = {
      {folder / "large.json", "larger than 1048576 bytes"},
      {folder / "empty.json", "empty"},
      {folder / "pipe.json", "not a regular file"},
      {folder.path(), "not a regular file"},
      {"/dev/zero", "not a regular file"},
  };
  for (const auto& [file, reason] : cases) {
    SCOPED_TRACE(file);
    std::vector<std::string> warnings;
    EXPECT_TRUE(read_tuning(file, warnings).text.empty());
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_NE(warnings[0].find(file.string()), std::string::npos) << warnings[0];
    EXPECT_NE(warnings[0].find(reason), std::string::npos) << warnings[0];
  }
  write_text(folder / "most.json", std::string(largest_tuning_file, ' '));
  std::vector<std::string> warnings;
  EXPECT_EQ(read_tuning(folder / "most.json", warnings).text.size(), largest_tuning_file);
  EXPECT_TRUE(warnings.empty());
}

TEST(SaveTuning, WhatIsSavedIsRead) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "new" / "weft" / "tuning.json";
  save_tuning(file, {sample_result()});
  std::vector<std::string> warnings;
  const Tuning tuning(sample_limits(), {}, {}, read_tuning(file, warnings));
  EXPECT_TRUE(warnings.empty());
  EXPECT_TRUE(tuning.warnings().empty());
  EXPECT_EQ(tuning.values(tunables::decode_pca), (std::vector<std::size_t>{8, 32}));
  EXPECT_EQ(tuning.source(tunables::decode_pca), file.string());
}

TEST(SaveTuning, ReplacesItsOwnEntryAndKeepsAllOthers) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "tuning.json";
  Json other_device = sample_entry();
  other_device["device"]["name"] = "Another";
  const Json other_kernel = {{"kernel", "of a later version"}, {"note", "kept"}};
  write_text(file, sample_database("", {sample_entry(), other_device, other_kernel}).text);
  save_tuning(file, {sample_result()});
  const Json root = Json::parse(text_of(file));
  ASSERT_EQ(root.at("entries").size(), 3U);
  EXPECT_EQ(root["entries"][0], other_device);
  EXPECT_EQ(root["entries"][1].at("note"), "kept");
  EXPECT_EQ(root["entries"][2].at("values"), (Json{{"PANELS", 8}, {"IMAGES", 32}}));
  EXPECT_EQ(root["entries"][2].at("measured").at("seconds"), 0.25);
  // the same again changes nothing
  const std::string before = text_of(file);
  save_tuning(file, {sample_result()});
  EXPECT_EQ(text_of(file), before);
}

TEST(SaveTuning, AFileOfAnotherKindIsLeftAsItIs) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "notes.json";
  for (const std::string text :
       {"my notes", "{}", "", R"({"format": "weft tuning", "version": 2})"}) {
    SCOPED_TRACE(text);
    write_text(file, text);
    expect_error(ErrorKind::input, {file.string()}, [&] { save_tuning(file, {sample_result()}); });
    EXPECT_EQ(text_of(file), text);
  }
  expect_error(ErrorKind::input, {"/dev/null"},
               [&] { save_tuning("/dev/null", {sample_result()}); });
}

}  // namespace
}  // namespace weft::test
