// Selections as they are recorded and reported.
#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>

#include "weft/btf/recorded_selection.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using Json = nlohmann::json;

// Throws a Json::exception for anything but a whole number that is not negative.
std::size_t count_of(const Json& value) {
  if (!value.is_number_unsigned()) throw Json::other_error::create(500, "no count", &value);
  return value.get<std::size_t>();
}

std::vector<std::size_t> counts_of(const Json& value) {
  if (!value.is_array()) throw Json::other_error::create(500, "no list", &value);
  std::vector<std::size_t> counts;
  counts.reserve(value.size());
  std::transform(value.begin(), value.end(), std::back_inserter(counts), count_of);
  return counts;
}

}  // namespace

std::string to_json(const RecordedSelection& selection) {
  const Selection& part = selection;
  std::string text = to_json(part);
  if (!selection.of || selection.selects_all()) return text;
  const BtfShape& of = *selection.of;
  text.back() = ',';
  return text + fmt::format("\"of\":[{},{},{},{},{}]}}", of.views, of.lights, of.height, of.width,
                            of.channels);
}

std::string ranges_text(std::span<const std::size_t> numbers, std::size_t runs) {
  std::string text;
  for (std::size_t first = 0, run = 0; first < numbers.size(); ++run) {
    if (run == runs) return text + ",...";
    std::size_t last = first;
    while (last + 1 < numbers.size() && numbers[last + 1] == numbers[last] + 1) ++last;
    if (!text.empty()) text += ",";
    text += fmt::format("{}", numbers[first]);
    if (last > first) text += fmt::format("-{}", numbers[last]);
    first = last + 1;
  }
  return text;
}

std::string to_text(const RecordedSelection& selection) {
  if (selection.selects_all()) return "all";
  std::string text;
  const auto add = [&](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  const auto add_list = [&](const char* name, const std::optional<std::vector<std::size_t>>& list,
                            std::size_t count) {
    if (!list) return;
    std::string part = fmt::format("{} {}", name, ranges_text(*list));
    if (selection.of) part += fmt::format(" of {}", count);
    add(part);
  };
  const BtfShape of = selection.of.value_or(BtfShape{});
  add_list("views", selection.views, of.views);
  add_list("lights", selection.lights, of.lights);
  if (selection.region) {
    const Region& region = *selection.region;
    std::string part =
        fmt::format("region {},{},{}x{}", region.x, region.y, region.width, region.height);
    if (selection.of) part += fmt::format(" of {} x {}", of.width, of.height);
    add(part);
  }
  add_list("channels", selection.channels, of.channels);
  if (selection.level != 0) add(fmt::format("level {}", selection.level));
  return text;
}

RecordedSelection recorded_from_json(std::string_view text, std::string_view where) {
  const Json json = Json::parse(text, nullptr, false);
  try {
    RecordedSelection selection;
    if (!json.is_object()) throw Json::other_error::create(500, "no object", &json);
    for (const auto& [key, value] : json.items()) {
      if (key == "views") {
        selection.views = counts_of(value);
      } else if (key == "lights") {
        selection.lights = counts_of(value);
      } else if (key == "channels") {
        selection.channels = counts_of(value);
      } else if (key == "level") {
        selection.level = count_of(value);
      } else if (key == "region") {
        selection.region = Region{count_of(value.at("x")), count_of(value.at("y")),
                                  count_of(value.at("width")), count_of(value.at("height"))};
      } else if (key == "of") {
        const std::vector<std::size_t> of = counts_of(value);
        if (of.size() != 5) throw Json::other_error::create(500, "no shape", &value);
        selection.of = BtfShape{of[0], of[1], of[2], of[3], of[4]};
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
