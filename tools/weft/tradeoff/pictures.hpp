// The pictures of trade-offs: strips of images cut from contact sheets, and their base64 form.
//
// A strip is a row of T tiles of equal size side by side, the images that stand for a material.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "weft/io/image.hpp"

namespace weft {

// 8-bit pixels [height][width][channels].
struct PixelImage {
  ImageInfo info;
  std::vector<std::byte> pixels;
};

PixelImage read_pixels(const std::filesystem::path& path);
void write_pixels(const std::filesystem::path& path, const PixelImage& image);

// How strips are reduced to keep a page small.
struct StripSize {
  std::size_t tiles = 4;   // the first so many
  std::size_t side = 128;  // the middle of each, of at most side x side texels
};

// Row `row` of a contact sheet of `count` images of width x height in one line, as a strip.
PixelImage cut_strip(const PixelImage& sheet, std::size_t row, std::size_t count, std::size_t width,
                     std::size_t height, const StripSize& size);
// A strip of `count` tiles, reduced.
PixelImage reduce_strip(const PixelImage& strip, std::size_t count, const StripSize& size);
// Means of 2 x 2 pixels; a last odd row or column is left out.
PixelImage halve(const PixelImage& image);

// "data:image/png;base64,...".
std::string data_url(const PixelImage& image);

std::string base64(std::span<const std::byte> bytes);

}  // namespace weft
