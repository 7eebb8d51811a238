// Output that appears whole or not at all: written to a temporary file in the same folder, flushed
// to disk, then renamed over its name.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>

namespace weft {

class AtomicFile {
 public:
  // Throws an input error if the folder does not exist or can't be written to.
  explicit AtomicFile(std::filesystem::path path);
  // Removes the temporary file unless commit() was reached.
  ~AtomicFile();
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;

  // Appends to what was written so far. Throws a run-time error that names the file (disk full, I/O
  // error).
  void write(std::span<const std::byte> bytes);
  // Overwrites bytes already written, or leaves a hole before them.
  void write_at(std::size_t offset, std::span<const std::byte> bytes);
  // The file's extent so far, holes included.
  std::size_t size() const { return size_; }
  // Flushes to disk and renames into place.
  void commit();
  // Commits two files of which each is useless without the other: if either can't be put into
  // place, both names are left as they were.
  static void commit_both(AtomicFile& first, AtomicFile& second);

  const std::filesystem::path& path() const { return path_; }

 private:
  void flush();
  void rename_into_place();

  std::filesystem::path path_;
  std::filesystem::path temporary_;
  int descriptor_ = -1;
  std::size_t size_ = 0;
};

}  // namespace weft
