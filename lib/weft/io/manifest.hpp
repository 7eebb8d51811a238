// Folders (or zips) of images with a manifest that says what each image shows.
//
// CSV: a header line names the columns, in any order; '#' begins a comment line.
//   file                                the image, relative to the folder
//   view_theta,view_phi                 degrees        or
//   view_x,view_y,view_z                a unit vector  or
//   view                                a line of views.txt beside the manifest, counted from 0
//                                       (see fixed_view.hpp), or none of these: a fixed view at the
//                                       zenith
//   light_theta,light_phi | light_x,light_y,light_z | light     the same for the light, lights.txt
//
// JSON: an object with the fields of btf_json.hpp, all optional, and
//   "images": [{"file": "a.png", "view": DIRECTION, "light": DIRECTION}, ...]
// where DIRECTION is a direction as in btf_json.hpp or an index into "views" or "lights"; without
// "view" it is the zenith. "mask" may name an image that is the mask of every view.
//
// Directions keep the order of the lists, or that of their first appearance. Layout `grid` (the
// default) asks for every view with every light exactly once; `paired` takes the images as pairs,
// in their order.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "weft/io/image_source.hpp"

namespace weft {

// "manifest.json" or "manifest.csv" in the collection's top folder, whichever there is; else
// nothing.
std::optional<std::size_t> find_manifest(const ImageCollection& collection);

// Opens the images by a manifest in the file system, or by the one in the collection where
// `manifest` is empty. What is wrong is an input error that names the manifest, the line or the
// image, and the value.
Capture open_manifest(std::shared_ptr<ImageCollection> collection,
                      const std::filesystem::path& manifest, std::optional<Layout> layout);

}  // namespace weft
