// What holds for the program as a whole, whichever subcommand runs.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/version.hpp"

namespace weft::test {
namespace {

// Every subcommand that `weft --help` lists.
std::vector<std::string> listed_subcommands() {
  const std::string help = run_weft({"--help"}).out;
  std::vector<std::string> names;
  std::size_t line = help.find("Subcommands:\n");
  EXPECT_NE(line, std::string::npos) << help;
  while ((line = help.find('\n', line)) != std::string::npos) {
    ++line;
    if (help.compare(line, 2, "  ") == 0 && help.compare(line, 3, "   ") != 0) {
      names.push_back(help.substr(line + 2, help.find(' ', line + 2) - line - 2));
    }
  }
  return names;
}

TEST(Program, Version) {
  const ProcessResult result = run_weft({"--version"});
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.out, std::string("weft ") + version() + "\n");
}

TEST(Program, EverySubcommandHelpsWithExamples) {
  const std::vector<std::string> names = listed_subcommands();
  EXPECT_GE(names.size(), 1U);
  for (const std::string& name : names) {
    const ProcessResult result = run_weft({name, "--help"});
    EXPECT_EQ(result.status, 0) << name;
    EXPECT_NE(result.out.find("Usage: weft " + name), std::string::npos) << result.out;
    EXPECT_NE(result.out.find("Examples:\n  weft " + name), std::string::npos) << result.out;
    EXPECT_EQ(result.err, "") << name;
  }
}

TEST(Program, EverySubcommandRefusesUnknownOptions) {
  for (const std::string& name : listed_subcommands()) {
    const ProcessResult result = run_weft({name, "--no-such-option"});
    EXPECT_EQ(result.status, 2) << name;
    EXPECT_EQ(result.out, "") << name;
    EXPECT_EQ(result.err.find("weft " + name + ": error: "), 0U) << result.err;
  }
}

TEST(Program, NoSubcommandIsBadUsage) {
  const ProcessResult result = run_weft({});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(result.err.find("weft: error: "), 0U) << result.err;
}

TEST(Program, NamesAnUnknownSubcommand) {
  const ProcessResult result = run_weft({"compres"});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.err, "weft: error: unknown subcommand 'compres'\nSee 'weft --help'.\n");
}

// A job of minutes, stopped by a signal as soon as it has begun to write.
void stop_while_writing(int signal) {
  const TemporaryFolder folder;
  const std::string output = folder / "cloth.safetensors";
  Process process(weft_command(
      {"synth", "--size", "256", "--view-set", "ubo151", "--light-set", "ubo151", "-o", output}));
  while (process.running() && std::filesystem::is_empty(folder.path())) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  process.send_signal(signal);
  const ProcessResult result = process.wait();
  EXPECT_EQ(result.status, 130);
  EXPECT_EQ(result.out, "");
  EXPECT_NE(result.err.find("weft synth: error: interrupted\n"), std::string::npos) << result.err;
  EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "a half file was left";
}

TEST(Program, InterruptLeavesNoHalfFile) {
  stop_while_writing(SIGINT);
}

TEST(Program, TerminationLeavesNoHalfFile) {
  stop_while_writing(SIGTERM);
}

}  // namespace
}  // namespace weft::test
