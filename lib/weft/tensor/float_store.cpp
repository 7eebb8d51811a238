#include "weft/tensor/float_store.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>

#include "weft/error.hpp"

namespace weft {
namespace {

std::size_t to_pages(std::size_t bytes) {
  static const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  return (bytes + page - 1) / page * page;
}

// A file without a name, with room for all bytes: a mapping of a file that the disk can't hold
// would end the process where it is written.
int nameless_file(std::size_t bytes) {
  const std::string folder = std::filesystem::temp_directory_path().string();
  std::string name = folder + "/weft-XXXXXX";
  const int descriptor = ::mkostemp(name.data(), O_CLOEXEC);
  if (descriptor < 0) fail_runtime("{}: no temporary file: {}", folder, std::strerror(errno));
  ::unlink(name.c_str());
  const int status = ::posix_fallocate(descriptor, 0, static_cast<off_t>(bytes));
  if (status != 0) {
    ::close(descriptor);
    fail_runtime("{}: no room for a temporary file of {} bytes: {}", folder, bytes,
                 std::strerror(status));
  }
  return descriptor;
}

}  // namespace

FloatStore::FloatStore(std::size_t count, Place place) : size_(count), place_(place) {
  if (count == 0) return;
  if (count > std::numeric_limits<std::size_t>::max() / (2 * sizeof(float))) {
    fail_runtime("{} values are more than can be addressed", count);
  }
  const std::size_t bytes = to_pages(count * sizeof(float));
  const bool in_file = place == Place::file;
  const int descriptor = in_file ? nameless_file(bytes) : -1;
  void* data = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                      in_file ? MAP_SHARED : MAP_PRIVATE | MAP_ANONYMOUS, descriptor, 0);
  const int error = errno;
  if (in_file) ::close(descriptor);
  if (data == MAP_FAILED) fail_runtime("no memory for {} values: {}", count, std::strerror(error));
  data_ = static_cast<float*>(data);
  mapped_bytes_ = bytes;
  // Where the system has large pages, hundreds of times fewer come one by one as they are written;
  // else this is refused, and no harm.
  constexpr std::size_t worth_it = std::size_t{4} << 20;
  if (!in_file && bytes >= worth_it) ::madvise(data, bytes, MADV_HUGEPAGE);
}

FloatStore::FloatStore(const std::vector<float>& values) : FloatStore(values.size()) {
  std::copy(values.begin(), values.end(), begin());
}

FloatStore::FloatStore(const FloatStore& other) : FloatStore(other.size_, other.place_) {
  std::copy(other.begin(), other.end(), begin());
}

FloatStore::~FloatStore() {
  if (data_ != nullptr) ::munmap(data_, mapped_bytes_);
}

void FloatStore::shrink(std::size_t count) {
  if (count >= size_) return;
  if (count == 0) {
    *this = FloatStore();
    return;
  }
  const std::size_t bytes = to_pages(count * sizeof(float));
  if (bytes < mapped_bytes_) {
    ::munmap(reinterpret_cast<std::byte*>(data_) + bytes, mapped_bytes_ - bytes);
  }
  mapped_bytes_ = bytes;
  size_ = count;
}

void FloatStore::release() const {
  if (place_ == Place::file && data_ != nullptr) ::madvise(data_, mapped_bytes_, MADV_DONTNEED);
}

bool operator==(const FloatStore& a, const FloatStore& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

}  // namespace weft
