// Single images: PNG and JPEG (8 bit; 16-bit PNG is refused by name), EXR (half or float), and
// Radiance .hdr (read only, as float).
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/tensor/dtype.hpp"

namespace weft {

struct ImageInfo {
  std::size_t height = 0;
  std::size_t width = 0;
  std::size_t channels = 0;  // 1 (grey) or 3 (RGB); an alpha channel is dropped
  DType dtype = DType::u8;   // U8 for PNG and JPEG, F16 or F32 for EXR, F32 for .hdr

  std::size_t bytes() const { return height * width * channels * size_of(dtype); }
  bool operator==(const ImageInfo&) const = default;
};

// True for names ending in .png, .jpg, .jpeg or .exr, whatever the case.
bool is_image_name(std::string_view name);

// Reads only what is needed to know sizes and type. The kind follows the content, not the name.
// `name` stands in error messages. The byte forms serve images inside archives.
ImageInfo image_info(const std::filesystem::path& path);
ImageInfo image_info(std::span<const std::byte> file, const std::string& name);

// Decodes into [Y][X][C] of the image's own dtype; `out` has exactly info.bytes(). Throws an input
// error that names the file if it is damaged or is not what `info` says.
void read_image(const std::filesystem::path& path, const ImageInfo& info, std::span<std::byte> out);
void read_image(std::span<const std::byte> file, const std::string& name, const ImageInfo& info,
                std::span<std::byte> out);

enum class ExrCompression { none, zip, piz };
// "none", "zip", "piz"; throws an input error that names `option`.
ExrCompression exr_compression_from_name(std::string_view name, std::string_view option);

// Writes [Y][X][C] as EXR, F16 or F32; channels R,G,B for 3, Y for 1, and otherwise the given names
// (or C0, C1, ...). Single-threaded and thread-safe. Throws a run-time error that names the file.
void write_exr(const std::filesystem::path& path, const ImageInfo& info,
               std::span<const std::byte> values, ExrCompression compression,
               std::span<const std::string> channel_names = {});

// Writes [Y][X][C] of U8 with 1 or 3 channels as PNG. `zlib_level` 0 to 9.
void write_png(const std::filesystem::path& path, const ImageInfo& info,
               std::span<const std::byte> values, int zlib_level = 4);

}  // namespace weft
