// Opens any capture that is made of image files; which kind it is follows from what lies there.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "weft/io/image_source.hpp"

namespace weft {

struct CaptureOptions {
  // "auto", "ubo2003", "manifest", "lights" or "flash".
  std::string kind = "auto";
  // A manifest or a list of lights outside of the folder; naming one decides the kind.
  std::filesystem::path manifest;
  std::filesystem::path lights_file;
  // For manifests that do not say it.
  std::optional<Layout> layout;
};

// `path` is a folder, a zip archive, or a manifest (.json or .csv) beside its images. The kind is,
// in this order, that of the options; "manifest" for a manifest.json or manifest.csv; "flash" for a
// camera_pos.txt with a light_pos.txt; "lights" for a lights.txt; "ubo2003" for images named by
// their directions. Throws an input error that says what was looked for.
Capture open_capture(const std::filesystem::path& path, const CaptureOptions& options);

}  // namespace weft
