// Captures of image files in a folder or a zip, made for tests.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/io/image.hpp"

namespace weft::test {

// Files by their names within a folder or an archive.
using Files = std::vector<std::pair<std::string, std::vector<std::byte>>>;

std::vector<std::byte> bytes_of_text(const std::string& text);
// The PNG file of smooth_image(info, seed).
std::vector<std::byte> smooth_png(const ImageInfo& info, unsigned seed);

void write_folder(const std::filesystem::path& folder, const Files& files);
// Deflated, or stored as they are.
void write_zip(const std::filesystem::path& path, const Files& files, bool deflate = true);

// All values of a source.
std::vector<std::byte> read_all(TileSource& source);

}  // namespace weft::test
