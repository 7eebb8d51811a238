#include "weft/io/atomic_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <random>
#include <string>
#include <utility>

#include "weft/error.hpp"

namespace weft {
namespace {

std::filesystem::path folder_of(const std::filesystem::path& path) {
  return path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
}

// A hidden name in the folder of `path`; its length does not grow with the length of the name.
std::filesystem::path hidden_name(const std::filesystem::path& path) {
  std::random_device random;
  return folder_of(path) / fmt::format(".weft-{:08x}{:08x}.part", random(), random());
}

// Makes a rename last through a crash. Some file systems can't; the file itself is on disk anyhow.
void flush_folder(const std::filesystem::path& path) {
  const int descriptor = ::open(folder_of(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path_, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    fail_input("{}: exists and is not a regular file", path_.string());
  }
  if (!path_.has_filename()) fail_input("\"{}\": not a file name", path_.string());
  do {  // another name if this one is taken
    temporary_ = hidden_name(path_);
    descriptor_ = ::open(temporary_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (descriptor_ < 0 && errno == EEXIST);
  if (descriptor_ < 0) {
    fail_input("{}: cannot create a file in this folder: {}", path_.string(), std::strerror(errno));
  }
}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::exchange(other.temporary_, {})),
      descriptor_(std::exchange(other.descriptor_, -1)),
      size_(std::exchange(other.size_, 0)) {}

void AtomicFile::write(std::span<const std::byte> bytes) {
  write_at(size_, bytes);
}

void AtomicFile::write_at(std::size_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t count =
        ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      fail_runtime("{}: cannot write: {}", path_.string(),
                   std::strerror(count < 0 ? errno : ENOSPC));
    }
    offset += static_cast<std::size_t>(count);
    bytes = bytes.subspan(static_cast<std::size_t>(count));
    size_ = std::max(size_, offset);
  }
}

void AtomicFile::flush() {
  if (::fsync(descriptor_) != 0) {
    fail_runtime("{}: cannot flush to disk: {}", path_.string(), std::strerror(errno));
  }
}

void AtomicFile::rename_into_place() {
  // Some file systems report a failed write only here.
  if (::close(std::exchange(descriptor_, -1)) != 0) {
    fail_runtime("{}: cannot close: {}", path_.string(), std::strerror(errno));
  }
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) {
    fail_runtime("{}: cannot rename into place: {}", path_.string(), std::strerror(errno));
  }
  temporary_.clear();
  flush_folder(path_);
}

void AtomicFile::commit() {
  flush();
  rename_into_place();
}

void AtomicFile::commit_both(AtomicFile& first, AtomicFile& second) {
  // Everything that can fail for want of space comes before the first rename.
  first.flush();
  second.flush();
  // A second name for what the first file replaces, so that it can be put back.
  const std::filesystem::path backup = hidden_name(first.path_);
  const bool replaces = ::link(first.path_.c_str(), backup.c_str()) == 0;
  if (!replaces && errno != ENOENT) {
    fail_runtime("{}: cannot keep the former file: {}", first.path_.string(), std::strerror(errno));
  }
  try {
    first.rename_into_place();
    second.rename_into_place();
  } catch (const Error&) {
    if (replaces) {
      ::rename(backup.c_str(), first.path_.c_str());
      ::unlink(backup.c_str());  // still there where both names are one file
    } else if (first.temporary_.empty()) {
      ::unlink(first.path_.c_str());
    }
    throw;
  }
  if (replaces) ::unlink(backup.c_str());
}

}  // namespace weft
