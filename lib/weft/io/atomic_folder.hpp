// A folder that appears whole or not at all: filled under a hidden name beside it, which takes its
// name in commit().
#pragma once

#include <filesystem>

namespace weft {

class AtomicFolder {
 public:
  // Throws an input error if there is a file of that name, a folder that is not empty (unless it is
  // to be replaced), or if nothing can be created there.
  AtomicFolder(const std::filesystem::path& folder, bool replace);
  // Removes what was written unless commit() was reached.
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  // Where files go until then.
  const std::filesystem::path& temporary() const { return temporary_; }
  // The name it will take, without a slash at its end.
  const std::filesystem::path& path() const { return folder_; }
  // What had the name before goes only once the new folder is in place.
  void commit();

 private:
  std::filesystem::path folder_;
  std::filesystem::path temporary_;
  bool replace_;
  bool committed_ = false;
};

}  // namespace weft
