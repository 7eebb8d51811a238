#include "weft/io/manifest.hpp"

#include <algorithm>
#include <map>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/fixed_view.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/manifest_table.hpp"

namespace weft {
namespace {

constexpr std::size_t largest_manifest = std::size_t{64} << 20;

// The directions of one side: a given list, or what appears, in that order.
class DirectionList {
 public:
  DirectionList(std::vector<Direction> given, const char* name)
      : directions_(std::move(given)), name_(name) {
    // Of equal directions the first stands for all: pairs are told by what they show.
    for (std::size_t i = 0; i < directions_.size(); ++i) places_.emplace(directions_[i], i);
  }

  std::size_t place(const DirectionOrIndex& value, const std::string& where) {
    if (const auto* index = std::get_if<std::size_t>(&value)) {
      if (*index >= directions_.size()) {
        fail_input("{}: {} {} of {}, counted from 0", where, name_, *index, directions_.size());
      }
      return *index;
    }
    const auto [found, is_new] = places_.emplace(std::get<Direction>(value), directions_.size());
    if (is_new) directions_.push_back(found->first);
    return found->second;
  }

  const std::vector<Direction>& directions() const { return directions_; }

 private:
  std::vector<Direction> directions_;
  std::map<Direction, std::size_t> places_;
  const char* name_;
};

Direction direction_of(const DirectionOrIndex& value, const std::vector<Direction>& list,
                       const char* name, const std::string& where) {
  if (const auto* direction = std::get_if<Direction>(&value)) return *direction;
  const std::size_t index = std::get<std::size_t>(value);
  if (index >= list.size()) {
    fail_input("{}: {} {} of {}, counted from 0", where, name, index, list.size());
  }
  return list[index];
}

std::size_t file_of(const ImageCollection& collection, std::string_view name,
                    const std::string& where) {
  std::string_view plain = name;
  if (plain.starts_with("./")) plain.remove_prefix(2);
  const std::optional<std::size_t> file = collection.find(plain);
  if (!file) {
    fail_input("{}: no file '{}' in {}", where, shown(name), collection.path().string());
  }
  return *file;
}

// The manifest's text, name and neighbours.
struct Found {
  std::string text;
  std::string where;
  TextBeside beside;
};

Found find_text(ImageCollection& collection, const std::filesystem::path& manifest) {
  if (!manifest.empty()) {
    return {read_text(manifest), manifest.string(),
            [folder = manifest.parent_path()](const std::string& name) {
              std::optional<std::string> text;
              std::error_code ignored;
              if (std::filesystem::exists(folder / name, ignored)) text = read_text(folder / name);
              return text;
            }};
  }
  const std::optional<std::size_t> file = find_manifest(collection);
  if (!file) {
    fail_input("{}: neither manifest.json nor manifest.csv", collection.path().string());
  }
  if (collection.bytes(*file).size() > largest_manifest) {
    fail_input("{}: more than {} bytes", collection.shown_name(*file), largest_manifest);
  }
  return {collection.text(*file), collection.shown_name(*file),
          [&collection](const std::string& name) {
            std::optional<std::string> text;
            if (const auto other = collection.find(name)) text = collection.text(*other);
            return text;
          }};
}

}  // namespace

std::optional<std::size_t> find_manifest(const ImageCollection& collection) {
  const std::optional<std::size_t> json = collection.find("manifest.json");
  return json ? json : collection.find("manifest.csv");
}

Capture open_manifest(std::shared_ptr<ImageCollection> collection,
                      const std::filesystem::path& manifest, std::optional<Layout> layout) {
  const Found found = find_text(*collection, manifest);
  const std::string& where = found.where;
  // What begins an object is JSON, whatever the name.
  const std::size_t first = found.text.find_first_not_of(" \t\r\n");
  const bool is_json = first != std::string::npos && found.text[first] == '{';
  ManifestTable table = is_json ? parse_json_manifest(found.text, where)
                                : parse_csv_manifest(found.text, where, found.beside);
  if (table.rows.empty()) fail_input("{}: no images", where);
  // Find the files.
  std::vector<std::size_t> row_files;
  std::map<std::size_t, std::size_t> row_of_file;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const ManifestRow& row = table.rows[i];
    row_files.push_back(file_of(*collection, row.file, row.where));
    const auto [other, is_new] = row_of_file.emplace(row_files.back(), i);
    if (!is_new) {
      fail_input("{}: file '{}' is listed before, at {}", row.where, shown(row.file),
                 table.rows[other->second].where);
    }
  }
  // Lay the images out.
  BtfInfo info;
  info.layout = layout.value_or(table.layout.value_or(Layout::grid));
  std::vector<std::size_t> files;
  if (info.layout == Layout::paired) {
    for (const ManifestRow& row : table.rows) {
      info.view_directions.push_back(direction_of(row.view, table.views, "view", row.where));
      info.light_directions.push_back(direction_of(row.light, table.lights, "light", row.where));
    }
    files = row_files;
    info.shape.views = files.size();
    info.shape.lights = 1;
  } else {
    DirectionList views(table.views, "view");
    DirectionList lights(table.lights, "light");
    std::vector<ViewLightFile> images;
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      const ManifestRow& row = table.rows[i];
      images.push_back(
          {views.place(row.view, row.where), lights.place(row.light, row.where), row_files[i]});
    }
    files = arrange_grid(*collection, std::move(images), views.directions(), lights.directions());
    info.view_directions = views.directions();
    info.light_directions = lights.directions();
    info.shape.views = info.view_directions.size();
    info.shape.lights = info.light_directions.size();
  }
  // Take over what else the manifest says.
  const ImageInfo image = collection->info_of(files.front());
  info.encoding = table.encoding.value_or(usual_encoding(image.dtype));
  info.quantity = table.quantity.value_or(Quantity::radiance);
  info.source = table.source.empty() ? collection->path().filename().string() : table.source;
  info.channel_names = table.channel_names;
  std::optional<std::size_t> mask;
  if (!table.mask_file.empty()) {
    mask = file_of(*collection, table.mask_file, where + ": \"mask\"");
    info.mask = read_mask_image(*collection, *mask, image, info.shape.views);
  } else if (table.mask) {
    info.mask = table.mask(info.shape.views * image.height * image.width);
  }
  Capture capture;
  capture.kind = "manifest";
  for (const std::size_t file : collection->images()) {
    if (!row_of_file.contains(file) && file != mask) {
      capture.ignored.push_back(collection->files()[file]);
    }
  }
  capture.source =
      std::make_shared<ImageSource>(std::move(collection), std::move(files), std::move(info));
  return capture;
}

}  // namespace weft
