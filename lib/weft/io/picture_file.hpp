// Rendered pictures as files: PNG as shown on a display, EXR (32-bit, R,G,B) of linear light.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>

#include "weft/io/image_folder.hpp"
#include "weft/scene/picture.hpp"

namespace weft {

// By the ending, .png or .exr; throws an input error that names `option` otherwise.
ImageFormat picture_format(const std::filesystem::path& path, std::string_view option);

// Writes a picture, whole or not at all. Exposure and curve are for PNG alone. Throws a run-time
// error that names the file.
void write_picture(const std::filesystem::path& path, const Picture& picture,
                   const ToneMapping& tone);

// Writes display values [height][width][3] as PNG, whole or not at all.
void write_display_values(const std::filesystem::path& path, std::size_t width, std::size_t height,
                          std::span<const double> values);

}  // namespace weft
