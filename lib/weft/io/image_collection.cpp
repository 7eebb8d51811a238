#include "weft/io/image_collection.hpp"

#include <zip.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <numeric>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/mapped_file.hpp"

namespace weft {
namespace {

// The largest member of an archive that is read, and how much of it at a time: memory grows with
// what is there, not with what is claimed.
constexpr std::size_t largest_member = std::size_t{1} << 30;
constexpr std::size_t chunk_bytes = std::size_t{1} << 20;

bool is_hidden(std::string_view file) {
  return file.starts_with('.') || file.find("/.") != std::string_view::npos ||
         file.starts_with("__MACOSX/");
}

class FolderCollection final : public ImageCollection {
 public:
  explicit FolderCollection(const std::filesystem::path& path) : ImageCollection(path) {
    namespace fs = std::filesystem;
    try {
      for (const fs::directory_entry& entry : fs::recursive_directory_iterator(path)) {
        if (!entry.is_regular_file()) continue;
        std::string file = entry.path().lexically_relative(path).generic_string();
        if (!is_hidden(file)) files_.push_back(std::move(file));
      }
    } catch (const fs::filesystem_error& error) {
      fail_input("{}: can't be listed: {}", path.string(), error.code().message());
    }
    sort_files();
  }

  std::span<const std::byte> bytes(std::size_t file) override {
    // Unmaps the one before first.
    open_.reset();
    open_.emplace(path_ / files_.at(file));
    return open_->bytes();
  }

 private:
  std::optional<MappedFile> open_;
};

struct CloseArchive {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct CloseMember {
  void operator()(zip_file_t* member) const { zip_fclose(member); }
};

class ZipCollection final : public ImageCollection {
 public:
  explicit ZipCollection(const std::filesystem::path& path) : ImageCollection(path) {
    int code = 0;
    archive_.reset(zip_open(path.c_str(), ZIP_RDONLY, &code));
    if (!archive_) {
      zip_error_t error;
      zip_error_init_with_code(&error, code);
      const std::string text = zip_error_strerror(&error);
      zip_error_fini(&error);
      fail_input("{}: not a readable zip archive: {}", path.string(), text);
    }
    const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
    std::vector<std::pair<std::string, zip_uint64_t>> members;
    for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(std::max<zip_int64_t>(count, 0)); ++i) {
      const char* name = zip_get_name(archive_.get(), i, ZIP_FL_ENC_GUESS);
      if (!name) fail_input("{}: member {} has no readable name", path.string(), i);
      std::string file = name;
      std::replace(file.begin(), file.end(), '\\', '/');
      if (file.empty() || file.ends_with('/') || is_hidden(file)) continue;
      members.emplace_back(std::move(file), i);
    }
    // Stable, so that members of one name keep the archive's order.
    std::stable_sort(members.begin(), members.end(),
                     [](const auto& a, const auto& b) { return natural_less(a.first, b.first); });
    for (auto& [file, index] : members) {
      files_.push_back(std::move(file));
      indices_.push_back(index);
    }
  }

  std::span<const std::byte> bytes(std::size_t file) override {
    const zip_uint64_t index = indices_.at(file);
    const std::string name = shown_name(file);
    const std::size_t size = checked_size(index, name);
    std::unique_ptr<zip_file_t, CloseMember> member(zip_fopen_index(archive_.get(), index, 0));
    if (!member) fail_input("{}: can't be read: {}", name, zip_strerror(archive_.get()));
    content_.clear();
    while (true) {
      const std::size_t at = content_.size();
      // One byte past the announced size shows whether the member ends there; reading to its end is
      // also what has the archive's checksum verified.
      content_.resize(std::min(at + chunk_bytes, size + 1));
      const zip_int64_t got = zip_fread(member.get(), content_.data() + at, content_.size() - at);
      if (got < 0) fail_input("{}: damaged: {}", name, zip_file_strerror(member.get()));
      content_.resize(at + static_cast<std::size_t>(got));
      if (content_.size() > size) fail_input("{}: longer than the {} bytes announced", name, size);
      if (got == 0) break;
    }
    if (content_.size() != size) {
      fail_input("{}: {} bytes where {} were announced", name, content_.size(), size);
    }
    return content_;
  }

 private:
  std::size_t checked_size(zip_uint64_t index, const std::string& name) const {
    zip_stat_t status;
    zip_stat_init(&status);
    if (zip_stat_index(archive_.get(), index, 0, &status) != 0 ||
        (status.valid & ZIP_STAT_SIZE) == 0) {
      fail_input("{}: of unknown size", name);
    }
    if ((status.valid & ZIP_STAT_ENCRYPTION_METHOD) != 0 &&
        status.encryption_method != ZIP_EM_NONE) {
      fail_input("{}: encrypted", name);
    }
    if (status.size > largest_member) {
      fail_input("{}: {} bytes, more than the {} that are read", name, status.size, largest_member);
    }
    return static_cast<std::size_t>(status.size);
  }

  std::unique_ptr<zip_t, CloseArchive> archive_;
  std::vector<zip_uint64_t> indices_;
  std::vector<std::byte> content_;
};

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

// The run of digits at the start, without leading zeros, removed from `text`.
std::string_view take_number(std::string_view& text) {
  std::size_t end = 0;
  while (end < text.size() && is_digit(text[end])) ++end;
  std::string_view digits = text.substr(0, end);
  text.remove_prefix(end);
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

}  // namespace

bool natural_less(std::string_view a, std::string_view b) {
  std::string_view left = a;
  std::string_view right = b;
  while (!left.empty() && !right.empty()) {
    if (is_digit(left.front()) && is_digit(right.front())) {
      const std::string_view m = take_number(left);
      const std::string_view n = take_number(right);
      if (m.size() != n.size()) return m.size() < n.size();
      if (m != n) return m < n;
    } else {
      if (left.front() != right.front()) return left.front() < right.front();
      left.remove_prefix(1);
      right.remove_prefix(1);
    }
  }
  if (left.empty() != right.empty()) return left.empty();
  return a < b;  // the same but for leading zeros
}

std::vector<std::size_t> ImageCollection::images() const {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    if (is_image_name(files_[i])) indices.push_back(i);
  }
  return indices;
}

std::optional<std::size_t> ImageCollection::find(std::string_view file) const {
  const auto found = std::lower_bound(files_.begin(), files_.end(), file, natural_less);
  if (found == files_.end() || *found != file) return std::nullopt;
  return static_cast<std::size_t>(found - files_.begin());
}

std::string ImageCollection::text(std::size_t file) {
  const std::span<const std::byte> content = bytes(file);
  return {reinterpret_cast<const char*>(content.data()), content.size()};
}

std::string ImageCollection::shown_name(std::size_t file) const {
  return path_.string() + "/" + shown(files_.at(file));
}

void ImageCollection::sort_files() {
  std::sort(files_.begin(), files_.end(), natural_less);
}

std::shared_ptr<ImageCollection> open_image_collection(const std::filesystem::path& given) {
  // "cat/" is "cat": its last component names the capture.
  std::filesystem::path path = given.lexically_normal();
  if (!path.has_filename() && path.has_relative_path()) path = path.parent_path();
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return std::make_shared<FolderCollection>(path);
  const MappedFile file(path);
  const auto bytes = file.bytes();
  if (bytes.size() < 4 || std::memcmp(bytes.data(), "PK", 2) != 0) {
    fail_input("{}: neither a folder nor a zip archive", path.string());
  }
  return std::make_shared<ZipCollection>(path);
}

}  // namespace weft
