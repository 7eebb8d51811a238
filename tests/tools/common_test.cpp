#include "common.hpp"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>

#include "progress.hpp"
#include "support/temporary_folder.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

// The message of the input error that `call` throws.
template <typename Call>
std::string input_error(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

TEST(ParseSize, Units) {
  EXPECT_EQ(parse_size("1", "--memory"), 1U);
  EXPECT_EQ(parse_size("4000000", "--memory"), 4000000U);
  EXPECT_EQ(parse_size("12B", "--memory"), 12U);
  EXPECT_EQ(parse_size("64KiB", "--memory"), 65536U);
  EXPECT_EQ(parse_size("512M", "--memory"), std::size_t{512} << 20);
  EXPECT_EQ(parse_size("1.5GiB", "--memory"), std::size_t{3} << 29);
  EXPECT_EQ(parse_size("2TiB", "--memory"), std::size_t{2} << 40);
  EXPECT_EQ(parse_size("1GB", "--memory"), 1000000000U);
  EXPECT_EQ(parse_size("0.5kB", "--memory"), 500U);
}

TEST(ParseSize, RefusesWhatIsNoSize) {
  for (const char* text : {"", "GiB", "-1GiB", "+1", "1 GiB", "1gib", "1e3x", "0x10", "nan", "inf",
                           "1GiBs", "0", "0.1", "5000000TiB", "1..5", "99999999999999999999999"}) {
    const std::string message = input_error([&] { parse_size(text, "--memory"); });
    EXPECT_NE(message.find("--memory"), std::string::npos) << text;
    EXPECT_NE(message.find(std::string("'") + text + "'"), std::string::npos) << message;
  }
}

TEST(OutputKind, FollowsTheName) {
  EXPECT_EQ(output_kind("cloth.weft"), OutputKind::model);
  EXPECT_EQ(output_kind("a.b/cloth.safetensors"), OutputKind::safetensors);
  EXPECT_EQ(output_kind("cloth.npy"), OutputKind::npy);
  EXPECT_EQ(output_kind("images"), OutputKind::folder);
  EXPECT_EQ(output_kind("images.v2/"), OutputKind::folder);
  EXPECT_NE(input_error([] { output_kind("cloth.tiff"); }).find("'.tiff'"), std::string::npos);
  input_error([] { output_kind(""); });
}

TEST(OutputKind, AnExistingFolderIsOneWhateverItsName) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "views.weft");
  EXPECT_EQ(output_kind(folder / "views.weft"), OutputKind::folder);
}

TEST(DeviceOptions, AreRead) {
  CLI::App app;
  DeviceOptions options;
  add_device_options(app, options);
  EXPECT_EQ(options.device, "auto");
  EXPECT_EQ(options.memory, std::size_t{2} << 30);
  EXPECT_FALSE(options.reference());
  app.parse("--device reference --memory 1GiB --profile");
  EXPECT_TRUE(options.reference());
  EXPECT_EQ(options.memory, std::size_t{1} << 30);
  EXPECT_TRUE(options.profile);
  EXPECT_THROW(app.parse("--memory much"), Error);
}

TEST(Seed, IsANumberOf64Bits) {
  CLI::App app;
  std::uint64_t seed = 0;
  add_seed_option(app, seed, "the test");
  app.parse("--seed 18446744073709551615");
  EXPECT_EQ(seed, std::numeric_limits<std::uint64_t>::max());
  for (const char* text : {"18446744073709551616", "99999999999999999999", "-1", "1.5", "x", ""}) {
    EXPECT_NE(input_error([&] {
                app.parse(std::vector<std::string>{text, "--seed"});
              }).find(std::string("--seed ") + text),
              std::string::npos)
        << text;
  }
}

TEST(Progress, Line) {
  EXPECT_EQ(Progress::line("writing", 0, 100, "images", 0.0), "writing 0/100 images");
  EXPECT_EQ(Progress::line("pass 1", 25, 100, "", 0.5), "pass 1 25/100, 50/s, 1.5 s left");
  EXPECT_EQ(Progress::line("writing", 25, 100, "images", 0.5),
            "writing 25/100 images, 50 images/s, 1.5 s left");
  EXPECT_EQ(Progress::line("writing", 100, 100, "images", 0.5),
            "writing 100/100 images, 200 images/s");
}

}  // namespace
}  // namespace weft::test
