#include <nlohmann/json.hpp>

#include "weft/btf/colour_transform.hpp"
#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using nlohmann::json;
using Kind = ColourTransform::Kind;

constexpr std::array<std::pair<Kind, std::string_view>, 5> kinds{
    {{Kind::none, "none"},
     {Kind::log, "log"},
     {Kind::ycrcb, "ycrcb"},
     {Kind::logluv, "logluv"},
     {Kind::decorrelated, "decorrelated"}}};

double read_number(const json& object, const char* key, std::string_view where) {
  const auto value = object.find(key);
  if (value == object.end() || !value->is_number()) fail_input("{}: no number \"{}\"", where, key);
  return value->get<double>();
}

std::vector<double> read_numbers(const json& list, const char* key, std::string_view where) {
  const auto is_number = [](const json& value) { return value.is_number(); };
  if (!list.is_array() || !std::all_of(list.begin(), list.end(), is_number)) {
    fail_input("{}: \"{}\" is no list of numbers", where, key);
  }
  return list.get<std::vector<double>>();
}

}  // namespace

std::string_view name_of(Kind kind) {
  for (const auto& [value, name] : kinds) {
    if (value == kind) return name;
  }
  return "?";
}

Kind colour_transform_from_name(std::string_view name, std::string_view where) {
  for (const auto& [value, known] : kinds) {
    if (known == name) return value;
  }
  fail_input("{}: '{}' is none of none, log, ycrcb, logluv, decorrelated", where, shown(name));
}

std::string to_text(const ColourTransform& transform) {
  if (transform.is_identity()) return "none";
  json object{{"name", name_of(transform.kind)}};
  if (!transform.is_linear()) {
    object["scale"] = transform.scale;
    object["largest"] = transform.largest;
  }
  if (transform.kind == Kind::decorrelated) object["axes"] = transform.axes;
  if (!transform.weights.empty()) object["weights"] = transform.weights;
  return object.dump();
}

ColourTransform colour_transform_from_text(std::string_view text, std::size_t channels,
                                           std::string_view where) {
  ColourTransform transform;
  if (text == "none") return transform;
  const json object = parse_json(text, where);
  if (!object.is_object()) {
    fail_input("{}: {} is neither \"none\" nor a JSON object", where, shown(text));
  }
  const auto name = object.find("name");
  if (name == object.end() || !name->is_string()) fail_input("{}: no text \"name\"", where);
  transform.kind = colour_transform_from_name(name->get<std::string>(), where);
  for (const auto& [key, value] : object.items()) {
    if (key == "name") continue;
    if (key == "weights") {
      transform.weights = read_numbers(value, "weights", where);
    } else if (key == "axes" && transform.kind == Kind::decorrelated) {
      transform.axes = read_numbers(value, "axes", where);
    } else if (transform.is_linear() || (key != "scale" && key != "largest")) {
      fail_input("{}: \"{}\" is nothing that {} has", where, shown(key), name_of(transform.kind));
    }
  }
  if (!transform.is_linear()) {
    transform.scale = read_number(object, "scale", where);
    transform.largest = read_number(object, "largest", where);
  }
  if (transform.is_identity()) fail_input("{}: {} has no \"weights\"", where, shown(text));
  validate(transform, channels, where);
  return transform;
}

}  // namespace weft
