#include <nlohmann/json.hpp>

#include "weft/btf/selection.hpp"
#include "weft/error.hpp"

namespace weft {

Selection selection_from_json(std::string_view text, std::string_view where) {
  using Json = nlohmann::json;
  const Json json = Json::parse(text, nullptr, false);
  try {
    Selection selection;
    if (!json.is_object()) throw Json::other_error::create(500, "no object", &json);
    for (const auto& [key, value] : json.items()) {
      if (key == "views") {
        selection.views = value.get<std::vector<std::size_t>>();
      } else if (key == "lights") {
        selection.lights = value.get<std::vector<std::size_t>>();
      } else if (key == "channels") {
        selection.channels = value.get<std::vector<std::size_t>>();
      } else if (key == "level") {
        selection.level = value.get<std::size_t>();
      } else if (key == "region") {
        selection.region =
            Region{value.at("x").get<std::size_t>(), value.at("y").get<std::size_t>(),
                   value.at("width").get<std::size_t>(), value.at("height").get<std::size_t>()};
      } else {
        throw Json::other_error::create(500, "unknown key " + key, &json);
      }
    }
    return selection;
  } catch (const Json::exception&) {
    fail_input("{}: '{}' is not a selection", where, text);
  }
}

}  // namespace weft
