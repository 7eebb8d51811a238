#include "weft/io/ubo2003.hpp"

#include <algorithm>
#include <cmath>
#include <compare>
#include <cstdint>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/ubo_names.hpp"

namespace weft {
namespace {

// An angle pair as exact decimals, so that equal directions compare equal and sort in rings.
struct Key {
  std::int64_t theta = 0;
  std::int64_t phi = 0;
  auto operator<=>(const Key&) const = default;
};
// Names carry at most nine decimals.
constexpr double key_scale = 1e9;

Key key_of(const AnglePair& angles, const std::string& name) {
  if (angles.theta > 90 || angles.phi > 360) {
    fail_input("{}: theta {} and phi {} are beyond 90 and 360 degrees", name, angles.theta,
               angles.phi);
  }
  Key key{std::llround(angles.theta * key_scale), std::llround(angles.phi * key_scale)};
  // A full turn is none, and the zenith has no azimuth.
  if (key.phi == std::llround(360 * key_scale) || key.theta == 0) key.phi = 0;
  return key;
}

// Sorts the keys and drops repetitions.
void make_set(std::vector<Key>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

std::size_t place_of(const std::vector<Key>& keys, const Key& key) {
  return static_cast<std::size_t>(std::lower_bound(keys.begin(), keys.end(), key) - keys.begin());
}

std::vector<Direction> directions_of(const std::vector<Key>& keys) {
  std::vector<Direction> directions;
  for (const Key& key : keys) {
    directions.push_back(direction_from_degrees(static_cast<double>(key.theta) / key_scale,
                                                static_cast<double>(key.phi) / key_scale));
  }
  return directions;
}

}  // namespace

bool has_ubo_names(const ImageCollection& collection) {
  return std::any_of(collection.files().begin(), collection.files().end(), [](const auto& file) {
    return is_image_name(file) && directions_in_name(file);
  });
}

Capture open_ubo2003(std::shared_ptr<ImageCollection> collection) {
  Capture capture;
  capture.kind = "ubo2003";
  // Read the names.
  struct Named {
    Key view, light;
    std::size_t file;
  };
  std::vector<Named> named;
  std::vector<Key> views, lights;
  for (const std::size_t file : collection->images()) {
    const std::string& name = collection->files()[file];
    const std::optional<NamedDirections> angles = directions_in_name(name);
    if (!angles) {
      capture.ignored.push_back(name);
      continue;
    }
    const std::string shown_name = collection->shown_name(file);
    named.push_back({key_of(angles->view, shown_name), key_of(angles->light, shown_name), file});
    views.push_back(named.back().view);
    lights.push_back(named.back().light);
  }
  if (named.empty()) {
    fail_input(
        "{}: no images named by their directions, as in \"00008 tl000 pl000 tv030 pv030.jpg\"",
        collection->path().string());
  }
  make_set(views);
  make_set(lights);
  // Lay the images out.
  BtfInfo info;
  info.shape.views = views.size();
  info.shape.lights = lights.size();
  info.view_directions = directions_of(views);
  info.light_directions = directions_of(lights);
  std::vector<ViewLightFile> images;
  for (const Named& image : named) {
    images.push_back({place_of(views, image.view), place_of(lights, image.light), image.file});
  }
  std::vector<std::size_t> files =
      arrange_grid(*collection, std::move(images), info.view_directions, info.light_directions);
  info.encoding =
      collection->info_of(files.front()).dtype == DType::u8 ? Encoding::gamma22 : Encoding::linear;
  info.source = collection->path().filename().string();
  capture.source =
      std::make_shared<ImageSource>(std::move(collection), std::move(files), std::move(info));
  return capture;
}

}  // namespace weft
