#include "weft/io/capture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "weft/error.hpp"
#include "weft/io/fixed_view.hpp"
#include "weft/io/manifest.hpp"
#include "weft/io/ubo2003.hpp"

namespace weft {
namespace {

constexpr std::array<std::string_view, 5> kinds{"auto", "ubo2003", "manifest", "lights", "flash"};

std::string kind_of(const ImageCollection& collection, const CaptureOptions& options) {
  if (options.kind != "auto") return options.kind;
  if (!options.manifest.empty()) return "manifest";
  if (!options.lights_file.empty()) return "lights";
  if (find_manifest(collection)) return "manifest";
  if (collection.find("camera_pos.txt") && collection.find("light_pos.txt")) return "flash";
  if (collection.find("lights.txt")) return "lights";
  if (has_ubo_names(collection)) return "ubo2003";
  fail_input(
      "{}: no capture: neither manifest.json, manifest.csv, lights.txt, camera_pos.txt with "
      "light_pos.txt, nor images named by their directions among {} files",
      collection.path().string(), collection.files().size());
}

}  // namespace

Capture open_capture(const std::filesystem::path& path, const CaptureOptions& given) {
  CaptureOptions options = given;
  if (std::find(kinds.begin(), kinds.end(), options.kind) == kinds.end()) {
    fail_input("kind '{}' is none of {}", options.kind, fmt::join(kinds, ", "));
  }
  if (!options.manifest.empty() && options.kind != "auto" && options.kind != "manifest") {
    fail_input("a manifest is given for a capture of kind '{}'", options.kind);
  }
  if (!options.lights_file.empty() && options.kind != "auto" && options.kind != "lights") {
    fail_input("a list of lights is given for a capture of kind '{}'", options.kind);
  }
  if (!options.manifest.empty() && !options.lights_file.empty()) {
    fail_input("both a manifest ({}) and a list of lights ({}) are given",
               options.manifest.string(), options.lights_file.string());
  }
  // A manifest stands for the folder that it lies in.
  std::filesystem::path folder = path;
  std::error_code ignored;
  const std::string ending = path.extension().string();
  if ((ending == ".json" || ending == ".csv") && !std::filesystem::is_directory(path, ignored)) {
    if (options.manifest.empty()) options.manifest = path;
    folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  }
  const std::shared_ptr<ImageCollection> collection = open_image_collection(folder);
  const std::string kind = kind_of(*collection, options);
  if (kind == "manifest") return open_manifest(collection, options.manifest, options.layout);
  if (kind == "lights") return open_fixed_view(collection, options.lights_file);
  if (kind == "flash") return open_flash(collection);
  return open_ubo2003(collection);
}

}  // namespace weft
