// A folder or a .zip of files, read one at a time: where captures come from.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/image.hpp"

namespace weft {

// The order people expect of numbered names: runs of digits compare as numbers, "x2" < "x10".
bool natural_less(std::string_view a, std::string_view b);

class ImageCollection {
 public:
  virtual ~ImageCollection() = default;

  // The folder or archive.
  const std::filesystem::path& path() const { return path_; }
  // Every file at any depth, by its name relative to the top with '/' between folders, in natural
  // order. Hidden files and the resource forks that some systems add to archives are left out.
  const std::vector<std::string>& files() const { return files_; }
  // The indices of those that are named like images.
  std::vector<std::size_t> images() const;
  // The file of exactly that name.
  std::optional<std::size_t> find(std::string_view file) const;

  // The content, valid until the next call. Throws an input error that names the file.
  virtual std::span<const std::byte> bytes(std::size_t file) = 0;
  std::string text(std::size_t file);
  // How a file stands in messages.
  std::string shown_name(std::size_t file) const;

  ImageInfo info_of(std::size_t file) { return image_info(bytes(file), shown_name(file)); }

 protected:
  explicit ImageCollection(std::filesystem::path path) : path_(std::move(path)) {}
  void sort_files();

  std::filesystem::path path_;
  std::vector<std::string> files_;
};

// Throws an input error if the path is neither a folder nor a zip archive.
std::shared_ptr<ImageCollection> open_image_collection(const std::filesystem::path& path);

}  // namespace weft
