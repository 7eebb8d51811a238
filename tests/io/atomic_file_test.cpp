// Output that appears whole or not at all, and files mapped for reading.
#include "weft/io/atomic_file.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <utility>

#include "io/file_bytes.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/temporary_folder.hpp"
#include "weft/io/mapped_file.hpp"
#include "weft/io/npy.hpp"

namespace weft {
namespace {

using test::count_files;
using test::expect_error;
using test::read_bytes;
using test::TemporaryFolder;
using test::write_bytes;

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text));
}

TEST(AtomicFile, AppearsWhenCommitted) {
  TemporaryFolder folder;
  AtomicFile file(folder / "f");
  file.write(bytes_of("abc"));
  file.write(bytes_of("def"));
  EXPECT_EQ(file.size(), 6u);
  file.write_at(1, bytes_of("X"));
  EXPECT_EQ(file.size(), 6u);
  file.write_at(8, bytes_of("Y"));
  EXPECT_EQ(file.size(), 9u);
  EXPECT_FALSE(std::filesystem::exists(folder / "f"));
  file.commit();
  EXPECT_EQ(read_bytes(folder / "f"), std::string("aXcdef\0\0Y", 9));
  EXPECT_EQ(count_files(folder.path()), 1u);
}

TEST(AtomicFile, LeavesNothingBehindUnlessCommitted) {
  TemporaryFolder folder;
  write_bytes(folder / "f", "before");
  { AtomicFile(folder / "f").write(bytes_of("after")); }
  EXPECT_EQ(read_bytes(folder / "f"), "before");
  EXPECT_EQ(count_files(folder.path()), 1u);
  AtomicFile file(folder / "f");
  file.write(bytes_of("after"));
  file.commit();
  EXPECT_EQ(read_bytes(folder / "f"), "after");
}

TEST(AtomicFile, MovesKeepOneOwner) {
  TemporaryFolder folder;
  AtomicFile first(folder / "f");
  first.write(bytes_of("a"));
  AtomicFile second(std::move(first));
  second.write(bytes_of("b"));
  second.commit();
  EXPECT_EQ(read_bytes(folder / "f"), "ab");
}

TEST(AtomicFile, HasThePermissionsOfANewFile) {
  TemporaryFolder folder;
  AtomicFile(folder / "f").commit();
  write_bytes(folder / "g", "");
  EXPECT_EQ(std::filesystem::status(folder / "f").permissions(),
            std::filesystem::status(folder / "g").permissions());
}

TEST(AtomicFile, RefusesPlacesWhereNoFileCanBe) {
  TemporaryFolder folder;
  expect_error(ErrorKind::input, {"none/f"}, [&] { AtomicFile(folder / "none/f"); });
  expect_error(ErrorKind::input, {folder.path().string(), "regular"},
               [&] { AtomicFile file(folder.path()); });
  expect_error(ErrorKind::input, {"/dev/null", "regular"}, [&] { AtomicFile("/dev/null"); });
  expect_error(ErrorKind::input, {"\"\""}, [&] { AtomicFile(""); });
  write_bytes(folder / "file", "");
  expect_error(ErrorKind::input, {"file/f"}, [&] { AtomicFile(folder / "file/f"); });
}

TEST(AtomicFile, LongNamesAreAllowed) {
  TemporaryFolder folder;
  const std::string name(255, 'n');
  AtomicFile(folder / name).commit();
  EXPECT_TRUE(std::filesystem::exists(folder / name));
}

// No room for more than `bytes` per file while it lives, as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    former_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &former_);
    rlimit limit = former_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &former_);
    std::signal(SIGXFSZ, former_handler_);
  }

 private:
  rlimit former_{};
  void (*former_handler_)(int) = nullptr;
};

TEST(AtomicFile, AFullDiskIsARunTimeErrorThatLeavesNothing) {
  TemporaryFolder folder;
  write_bytes(folder / "f", "before");
  {
    const FileSizeLimit limit(4096);
    AtomicFile file(folder / "f");
    file.write(bytes_of(std::string(4000, 'a')));
    expect_error(ErrorKind::runtime, {"/f", "cannot write"},
                 [&] { file.write(bytes_of(std::string(4000, 'a'))); });
  }
  EXPECT_EQ(read_bytes(folder / "f"), "before");
  EXPECT_EQ(count_files(folder.path()), 1u);
}

TEST(AtomicFile, TwoFilesAreCommittedTogetherOrNotAtAll) {
  TemporaryFolder folder;
  const BtfInfo info = test::make_info({1, 1, 1, 1, 1}, DType::u8);
  const std::vector<std::byte> value(1);
  for (const bool replacing : {false, true}) {
    if (replacing) write_bytes(folder / "a.json", "before");
    auto sink = create_npy_btf(folder / "a.npy", info);
    sink->write(0, 1, value);
    // In the way of one of the two.
    std::filesystem::create_directories(folder / "a.npy" / "inner");
    expect_error(ErrorKind::runtime, {"a.npy"}, [&] { sink->finish(); });
    sink.reset();
    std::filesystem::remove_all(folder / "a.npy");
    EXPECT_EQ(count_files(folder.path()), replacing ? 1u : 0u);
    if (replacing) {
      EXPECT_EQ(read_bytes(folder / "a.json"), "before");
    }
  }
  // In the way of the other.
  std::filesystem::remove(folder / "a.json");
  write_bytes(folder / "a.npy", "before");
  auto sink = create_npy_btf(folder / "a.npy", info);
  sink->write(0, 1, value);
  std::filesystem::create_directories(folder / "a.json" / "inner");
  expect_error(ErrorKind::runtime, {"a.json"}, [&] { sink->finish(); });
  sink.reset();
  EXPECT_EQ(read_bytes(folder / "a.npy"), "before");
  EXPECT_EQ(count_files(folder.path()), 2u);

  // Over files that are there.
  std::filesystem::remove_all(folder / "a.json");
  write_bytes(folder / "a.json", "before");
  sink = create_npy_btf(folder / "a.npy", info);
  sink->write(0, 1, value);
  sink->finish();
  EXPECT_NE(read_bytes(folder / "a.json"), "before");
  EXPECT_NE(read_bytes(folder / "a.npy"), "before");
  EXPECT_EQ(count_files(folder.path()), 2u);
}

TEST(MappedFile, HoldsTheBytesAndReleasesOnlyPages) {
  TemporaryFolder folder;
  std::string text;
  for (int i = 0; i < 20000; ++i) text += static_cast<char>('a' + i % 26);
  write_bytes(folder / "f", text);
  MappedFile file(folder / "f");
  const auto view = [&] {
    return std::string(reinterpret_cast<const char*>(file.bytes().data()), file.bytes().size());
  };
  EXPECT_EQ(view(), text);
  constexpr auto everything = static_cast<std::size_t>(-1);
  for (const auto& [offset, length] : {std::pair<std::size_t, std::size_t>{0, 20000},
                                       {1, 4096},
                                       {5000, 10000},
                                       {19999, 1},
                                       {20000, 5},
                                       {30000, 1},
                                       {3, everything},
                                       {everything, everything}}) {
    file.release(offset, length);
    file.prefetch(offset, length);
    EXPECT_EQ(view(), text);
  }
  MappedFile other(std::move(file));
  EXPECT_EQ(other.bytes().size(), text.size());
  other = MappedFile(folder / "f");
  EXPECT_EQ(other.bytes().size(), text.size());
}

TEST(MappedFile, EmptyFilesAndNoFiles) {
  TemporaryFolder folder;
  write_bytes(folder / "empty", "");
  const MappedFile empty(folder / "empty");
  EXPECT_TRUE(empty.bytes().empty());
  empty.release(0, 100);
  empty.prefetch(0, 100);
  expect_error(ErrorKind::input, {"absent", "No such file"},
               [&] { MappedFile file(folder / "absent"); });
  expect_error(ErrorKind::input, {folder.path().string(), "regular"},
               [&] { MappedFile file(folder.path()); });
  // A pipe is refused, not waited for.
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  expect_error(ErrorKind::input, {"pipe", "regular"}, [&] { MappedFile file(folder / "pipe"); });
}

}  // namespace
}  // namespace weft
