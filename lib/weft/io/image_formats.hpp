// What the image formats share inside the library; the public side is image.hpp.
//
// Every reader works on a whole file in memory, so that files and members of archives take one
// path.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "weft/io/image.hpp"

namespace weft::formats {

using Bytes = std::span<const std::byte>;

// The longest side that is believed, whatever a header claims.
inline constexpr std::size_t max_image_side = 65536;
// The most bytes that one decoded image may have.
inline constexpr std::size_t max_image_bytes = std::size_t{1} << 32;

// Throws an input error unless the sides are within [1, max_image_side] and the decoded image is no
// larger than max_image_bytes and than `max_ratio` times the file it is said to come from.
void check_size(const std::string& name, std::size_t width, std::size_t height,
                std::size_t bytes_per_pixel, std::size_t file_bytes, std::size_t max_ratio);

bool is_png(Bytes file);
ImageInfo png_info(Bytes file, const std::string& name);
void read_png(Bytes file, const std::string& name, const ImageInfo& info, std::span<std::byte> out);
// The PNG file of an image, in memory. `name` stands in error messages.
std::vector<std::byte> encode_png(const std::string& name, const ImageInfo& info, Bytes values,
                                  int zlib_level);

bool is_jpeg(Bytes file);
ImageInfo jpeg_info(Bytes file, const std::string& name);
void read_jpeg(Bytes file, const std::string& name, const ImageInfo& info,
               std::span<std::byte> out);

bool is_hdr(Bytes file);
ImageInfo hdr_info(Bytes file, const std::string& name);
void read_hdr(Bytes file, const std::string& name, const ImageInfo& info, std::span<std::byte> out);

bool is_exr(Bytes file);
ImageInfo exr_info(Bytes file, const std::string& name);
void read_exr(Bytes file, const std::string& name, const ImageInfo& info, std::span<std::byte> out);
// The EXR file of an image, in memory.
std::vector<std::byte> encode_exr(const std::string& name, const ImageInfo& info, Bytes values,
                                  ExrCompression compression,
                                  std::span<const std::string> channel_names);

}  // namespace weft::formats
