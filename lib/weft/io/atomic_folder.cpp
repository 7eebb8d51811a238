#include "weft/io/atomic_folder.hpp"

#include <random>

#include "weft/error.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

// The folder's name without a slash at its end.
fs::path plain(const fs::path& folder) {
  fs::path path = folder.lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  if (path.empty() || path == path.root_path() || path == "." || path == "..") {
    fail_input("\"{}\": not the name of a folder to create", folder.string());
  }
  return path;
}

fs::path hidden_folder_beside(const fs::path& path) {
  std::random_device random;
  return path.parent_path() / fmt::format(".weft-{:08x}{:08x}.part", random(), random());
}

}  // namespace

AtomicFolder::AtomicFolder(const fs::path& folder, bool replace)
    : folder_(plain(folder)), replace_(replace) {
  std::error_code error;
  // A link stays: the folder that it leads to is the one to be made.
  if (fs::is_symlink(folder_, error)) {
    folder_ = fs::canonical(folder_, error);
    if (error) fail_input("{}: a link to no folder: {}", folder.string(), error.message());
  }
  const fs::file_status status = fs::status(folder_, error);
  if (fs::exists(status)) {
    if (!fs::is_directory(status)) fail_input("{}: exists and is no folder", folder_.string());
    if (!replace_ && !fs::is_empty(folder_, error)) {
      fail_input("{}: exists and is not empty", folder_.string());
    }
  }
  do {  // another name if this one is taken
    temporary_ = hidden_folder_beside(folder_);
  } while (!fs::create_directory(temporary_, error) && !error);
  if (error) {
    fail_input("{}: cannot create a folder there: {}", folder_.string(), error.message());
  }
}

AtomicFolder::~AtomicFolder() {
  if (committed_) return;
  std::error_code ignored;
  fs::remove_all(temporary_, ignored);
}

void AtomicFolder::commit() {
  std::error_code error;
  fs::path before;
  if (replace_ && fs::exists(folder_, error)) {
    before = hidden_folder_beside(folder_);
    fs::rename(folder_, before, error);
    if (error) fail_runtime("{}: can't be replaced: {}", folder_.string(), error.message());
  }
  fs::rename(temporary_, folder_, error);
  if (error) {
    std::error_code ignored;
    if (!before.empty()) fs::rename(before, folder_, ignored);
    fail_runtime("{}: can't be put in place: {}", folder_.string(), error.message());
  }
  committed_ = true;
  if (!before.empty()) fs::remove_all(before, error);
}

}  // namespace weft
