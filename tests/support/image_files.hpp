// Image files that tests need and the library does not write.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "weft/io/image.hpp"

namespace weft::test {

// A JPEG of `info` (U8, 1 or 3 channels) at the given quality, without chroma subsampling.
std::vector<std::byte> make_jpeg(const ImageInfo& info, std::span<const std::byte> values,
                                 int quality = 95, bool progressive = false);

// Whole files.
std::vector<std::byte> file_bytes(const std::filesystem::path& path);
void write_bytes(const std::filesystem::path& path, std::span<const std::byte> bytes);
void write_text(const std::filesystem::path& path, const std::string& text);

// [Y][X][C] of U8 that differs between seeds and changes smoothly within an image.
std::vector<std::byte> smooth_image(const ImageInfo& info, unsigned seed);

}  // namespace weft::test
