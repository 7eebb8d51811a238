// Captures whose directions stand in plain text beside the images, line k for image k in natural
// order: a fixed view under several lights, and pairs of a camera and a light that move together.
//
//   lights.txt            a count, then as many unit vectors; or the vectors alone
//   camera_pos.txt,       a position per image, relative to the sample's centre, z up along its
//   light_pos.txt         normal, in any unit
//
// Numbers are separated by blanks or commas; '#' begins a comment.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/image_source.hpp"

namespace weft {

// The vectors of such a text. Throws an input error that names `where`, the line and what is wrong
// with it, also where a count does not match.
std::vector<std::array<double, 3>> parse_vectors(std::string_view text, const std::string& where);

// The same as directions: of unit length within 1e-3, then made so to float rounding.
std::vector<Direction> parse_directions(std::string_view text, const std::string& where);

// The vector's direction; vectors that already are of unit length to float rounding stay as they
// are. Throws an input error that names `where` for one of no length, or further from 1 than
// `tolerance`.
Direction unit_direction(const std::array<double, 3>& vector, double tolerance,
                         const std::string& where);

// A whole text file from the file system, of at most 64 MiB.
std::string read_text(const std::filesystem::path& path);

// A fixed view at the zenith. `lights_file` may be empty: lights.txt in the collection's top
// folder. An image named as a mask (see is_mask_name) becomes the mask; more than one is an error.
Capture open_fixed_view(std::shared_ptr<ImageCollection> collection,
                        const std::filesystem::path& lights_file);

// Near-field pairs, layout `paired`, by camera_pos.txt and light_pos.txt in the collection: the
// directions are those at the sample's centre.
Capture open_flash(std::shared_ptr<ImageCollection> collection);

}  // namespace weft
