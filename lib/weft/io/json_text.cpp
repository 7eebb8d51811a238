#include "weft/io/json_text.hpp"

#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "weft/error.hpp"

namespace weft {

using nlohmann::json;

nlohmann::json parse_json(std::string_view text, std::string_view where) {
  constexpr int max_depth = 32;
  // The parser takes a NUL for the end of the text.
  if (text.find('\0') != std::string_view::npos) fail_input("{}: NUL character in JSON", where);
  std::vector<std::set<std::string>> keys;  // of the objects that are open
  const auto check = [&](int depth, json::parse_event_t event, json& parsed) {
    if (depth > max_depth) fail_input("{}: JSON nested deeper than {}", where, max_depth);
    if (event == json::parse_event_t::object_start) {
      keys.emplace_back();
    } else if (event == json::parse_event_t::object_end) {
      keys.pop_back();
    } else if (event == json::parse_event_t::key) {
      const auto& key = parsed.get_ref<const std::string&>();
      if (!keys.back().insert(key).second) {
        fail_input("{}: JSON key \"{}\" appears twice", where, shown(key));
      }
    }
    return true;
  };
  try {
    return json::parse(text, check);
  } catch (const json::exception& error) {
    // without "[json.exception.parse_error.101] ", which says nothing to a reader
    const std::string_view what = error.what();
    const std::size_t number = what.find("] ");
    fail_input("{}: not valid JSON: {}", where,
               shown(what.substr(number == std::string_view::npos ? 0 : number + 2), 400));
  }
}

std::string shown(std::string_view text, std::size_t limit) {
  std::string result;
  for (const char c : text.substr(0, limit)) {
    if (c >= ' ' && c <= '~') {
      result += c;
    } else {
      result += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    }
  }
  if (text.size() > limit) result += "...";
  return result;
}

}  // namespace weft
