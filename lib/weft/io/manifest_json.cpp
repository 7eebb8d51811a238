#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/io/btf_json.hpp"
#include "weft/io/fixed_view.hpp"
#include "weft/io/json_text.hpp"
#include "weft/io/manifest_table.hpp"

namespace weft {
namespace {

using nlohmann::json;

// The direction as it is, so that what was written comes back to the bit; of unit length within
// 1e-3.
Direction checked(const Direction& direction, const std::string& where) {
  unit_direction({direction[0], direction[1], direction[2]}, 1e-3, where);
  return direction;
}

DirectionOrIndex read_side(const json& image, const char* key, const std::string& where) {
  const auto value = image.find(key);
  const std::string name = fmt::format("{}: \"{}\"", where, key);
  if (value == image.end()) {
    if (std::string_view(key) == "view") return Direction{0, 0, 1};
    fail_input("{} is missing", name);
  }
  if (value->is_number()) {
    if (!value->is_number_unsigned()) fail_input("{}: {} is not an index", name, value->dump());
    return value->get<std::size_t>();
  }
  return checked(read_direction(*value, name), name);
}

std::vector<Direction> read_list(const json& root, const char* key, const std::string& where) {
  if (!root.contains(key)) return {};
  std::vector<Direction> directions = read_directions(root, key, where);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    directions[i] = checked(directions[i], fmt::format("{}: {}[{}]", where, key, i));
  }
  return directions;
}

}  // namespace

ManifestTable parse_json_manifest(std::string_view text, const std::string& where) {
  const json root = parse_json(text, where);
  if (!root.is_object()) fail_input("{}: not a JSON object", where);
  ManifestTable table;
  if (root.contains("encoding")) {
    table.encoding =
        encoding_from_name(read_string(root, "encoding", "", where), where + ": encoding");
  }
  if (root.contains("quantity")) {
    table.quantity =
        quantity_from_name(read_string(root, "quantity", "", where), where + ": quantity");
  }
  if (root.contains("layout")) {
    table.layout = layout_from_name(read_string(root, "layout", "", where), where + ": layout");
  }
  table.source = read_string(root, "source", "", where);
  table.channel_names = read_channel_names(root, where);
  table.views = read_list(root, "views", where);
  table.lights = read_list(root, "lights", where);
  table.mask_file = read_string(root, "mask", "", where);
  if (root.contains("mask_runs")) {
    if (!table.mask_file.empty()) fail_input("{}: both \"mask\" and \"mask_runs\"", where);
    table.mask = [runs = json{{"mask_runs", root["mask_runs"]}}, where](std::size_t size) {
      return read_mask(runs, size, where);
    };
  }
  const auto images = root.find("images");
  if (images == root.end() || !images->is_array()) fail_input("{}: no list \"images\"", where);
  for (std::size_t i = 0; i < images->size(); ++i) {
    const json& image = (*images)[i];
    const std::string name = fmt::format("{}: images[{}]", where, i);
    if (!image.is_object()) fail_input("{} is not an object", name);
    const std::string file = read_string(image, "file", "", name);
    if (file.empty()) fail_input("{}: \"file\" is missing", name);
    table.rows.push_back(
        {file, read_side(image, "view", name), read_side(image, "light", name), name});
  }
  return table;
}

}  // namespace weft
