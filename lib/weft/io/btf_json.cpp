#include "weft/io/btf_json.hpp"

#include <nlohmann/json.hpp>
#include <utility>

#include "weft/error.hpp"

namespace weft {

using nlohmann::json;

namespace {

double number(const json& value, const std::string& where) {
  if (!value.is_number()) fail_input("{}: not a number", where);
  return value.get<double>();
}

json mask_runs(const std::vector<std::uint8_t>& mask) {
  json runs = json::array();
  std::size_t length = 0;
  std::uint8_t current = 0;
  for (const std::uint8_t value : mask) {
    if (value != current) {
      runs.push_back(std::exchange(length, 0));
      current = value;
    }
    ++length;
  }
  runs.push_back(length);
  return runs;
}

json directions_json(const std::vector<Direction>& directions) {
  json list = json::array();
  for (const Direction& direction : directions) {
    list.push_back(
        {{"dir", direction}, {"theta", theta_degrees(direction)}, {"phi", phi_degrees(direction)}});
  }
  return list;
}

}  // namespace

Direction read_direction(const json& value, const std::string& where) {
  if (value.is_object() && value.contains("dir")) return read_direction(value["dir"], where);
  if (value.is_object() && value.contains("theta") && value.contains("phi")) {
    return direction_from_degrees(number(value["theta"], where), number(value["phi"], where));
  }
  if (value.is_array() && value.size() == 2) {
    return direction_from_degrees(number(value[0], where), number(value[1], where));
  }
  if (value.is_array() && value.size() == 3) {
    return {static_cast<float>(number(value[0], where)),
            static_cast<float>(number(value[1], where)),
            static_cast<float>(number(value[2], where))};
  }
  fail_input("{}: neither [x, y, z] nor theta and phi in degrees", where);
}

std::vector<Direction> read_directions(const json& root, const char* key,
                                       const std::string& where) {
  const auto list = root.find(key);
  if (list == root.end() || !list->is_array()) fail_input("{}: no list \"{}\"", where, key);
  std::vector<Direction> directions;
  for (std::size_t i = 0; i < list->size(); ++i) {
    directions.push_back(read_direction((*list)[i], fmt::format("{}: {}[{}]", where, key, i)));
  }
  return directions;
}

std::string read_string(const json& root, const char* key, const std::string& absent,
                        const std::string& where) {
  const auto value = root.find(key);
  if (value == root.end()) return absent;
  if (!value->is_string()) fail_input("{}: \"{}\" is not a string", where, key);
  return value->get<std::string>();
}

std::vector<std::string> read_channel_names(const json& root, const std::string& where) {
  std::vector<std::string> names;
  const auto list = root.find("channel_names");
  if (list == root.end()) return names;
  if (!list->is_array()) fail_input("{}: \"channel_names\" is no list", where);
  for (const json& name : *list) {
    if (!name.is_string()) fail_input("{}: \"channel_names\" holds more than strings", where);
    names.push_back(name.get<std::string>());
  }
  return names;
}

// `size` is no mere claim: the values of as many texels are in the file.
std::vector<std::uint8_t> read_mask(const json& root, std::size_t size, const std::string& where) {
  std::vector<std::uint8_t> mask;
  const auto runs = root.find("mask_runs");
  if (runs == root.end()) return mask;
  if (!runs->is_array()) fail_input("{}: \"mask_runs\" is no list", where);
  std::uint8_t current = 0;
  for (const json& run : *runs) {
    if (!run.is_number_unsigned() || run.get<std::size_t>() > size - mask.size()) {
      fail_input("{}: \"mask_runs\" do not add up to the {} texels of all views", where, size);
    }
    mask.insert(mask.end(), run.get<std::size_t>(), current);
    current ^= 1;
  }
  if (mask.size() != size) {
    fail_input("{}: \"mask_runs\" add up to {} of the {} texels of all views", where, mask.size(),
               size);
  }
  return mask;
}

void describe(const BtfInfo& info, nlohmann::ordered_json& root) {
  root["encoding"] = name_of(info.encoding);
  root["quantity"] = name_of(info.quantity);
  root["layout"] = name_of(info.layout);
  root["source"] = info.source;
  if (!info.channel_names.empty()) root["channel_names"] = info.channel_names;
  root["views"] = directions_json(info.view_directions);
  root["lights"] = directions_json(info.light_directions);
  if (!info.mask.empty()) root["mask_runs"] = mask_runs(info.mask);
}

std::string dump(const nlohmann::ordered_json& root, const std::string& where) {
  try {
    return root.dump(1) + "\n";
  } catch (const json::exception&) {
    fail_input("{}: source or a channel name is not valid UTF-8", where);
  }
}

}  // namespace weft
