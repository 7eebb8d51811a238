// Folders that appear whole or not at all.
#include "weft/io/atomic_folder.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "support/expect_error.hpp"
#include "support/temporary_folder.hpp"

namespace weft::test {
namespace {

namespace fs = std::filesystem;

void put(const fs::path& path) {
  std::ofstream(path) << "x";
}
std::size_t entries(const fs::path& folder) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder)) ++count;
  return count;
}

TEST(AtomicFolder, TakesItsNameAtTheEnd) {
  const TemporaryFolder here;
  const fs::path name = fs::path(here / "frames") / "";
  {
    AtomicFolder folder(name, false);
    put(folder.temporary() / "a");
    EXPECT_FALSE(fs::exists(folder.path()));
    folder.commit();
  }
  EXPECT_TRUE(fs::exists(here / "frames/a"));
  EXPECT_EQ(entries(here / "."), 1u);
}

TEST(AtomicFolder, LeavesNothingWithoutCommit) {
  const TemporaryFolder here;
  {
    const AtomicFolder folder(here / "frames", false);
    put(folder.temporary() / "a");
  }
  EXPECT_EQ(entries(here / "."), 0u);
}

TEST(AtomicFolder, ReplacesOnlyWhereAskedTo) {
  const TemporaryFolder here;
  fs::create_directory(here / "frames");
  { AtomicFolder(here / "frames", false).commit(); }  // an empty one gives way
  put(here / "frames/old");
  expect_error(ErrorKind::input, {"frames", "not empty"},
               [&] { AtomicFolder(here / "frames", false); });
  {
    AtomicFolder folder(here / "frames", true);
    put(folder.temporary() / "new");
    folder.commit();
  }
  EXPECT_TRUE(fs::exists(here / "frames/new"));
  EXPECT_FALSE(fs::exists(here / "frames/old"));
  EXPECT_EQ(entries(here / "."), 1u);
}

TEST(AtomicFolder, FollowsLinks) {
  const TemporaryFolder here;
  fs::create_directory(here / "real");
  fs::create_directory_symlink("real", here / "link");
  for (const bool replace : {false, true}) {
    AtomicFolder folder(here / "link", replace);
    put(folder.temporary() / (replace ? "second" : "first"));
    folder.commit();
    EXPECT_TRUE(fs::is_symlink(here / "link"));
    EXPECT_EQ(entries(here / "real"), 1u);
    EXPECT_TRUE(fs::exists(here / (replace ? "real/second" : "real/first")));
    EXPECT_EQ(entries(here / "."), 2u);
  }
  fs::create_directory_symlink("nothing", here / "dangling");
  expect_error(ErrorKind::input, {"dangling", "link"},
               [&] { AtomicFolder(here / "dangling", true); });
}

TEST(AtomicFolder, RefusesWhatIsNoFolder) {
  const TemporaryFolder here;
  put(here / "file");
  expect_error(ErrorKind::input, {"file", "no folder"}, [&] { AtomicFolder(here / "file", true); });
  expect_error(ErrorKind::input, {"missing"}, [&] { AtomicFolder(here / "missing/a", true); });
  expect_error(ErrorKind::input, {"."}, [] { AtomicFolder(".", true); });
}

}  // namespace
}  // namespace weft::test
