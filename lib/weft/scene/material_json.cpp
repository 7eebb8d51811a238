// Materials in JSON: the fields that makers describe, read strictly.
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <set>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"
#include "weft/scene/material.hpp"
#include "weft/scene/material_kinds.hpp"

namespace weft {
namespace {

using nlohmann::json;

// Reads fields from an object. Every one that is asked for is known; on closing, any other is an
// error.
class FieldReader final : public Fields {
 public:
  FieldReader(const json& root, std::string_view where) : where_(where) {
    levels_.push_back({&root, {}});
  }
  using Fields::number;

  void number(std::string_view name, double& value, double low, double high,
              std::string_view /*meaning*/) override {
    if (const json* field = find(name)) value = number_of(*field, path_.of(name), low, high);
  }

  void count(std::string_view name, std::size_t& value, std::size_t low, std::size_t high,
             std::string_view /*meaning*/) override {
    const json* field = find(name);
    if (field == nullptr) return;
    if (!field->is_number_unsigned() || field->get<std::uint64_t>() < low ||
        field->get<std::uint64_t>() > high) {
      refuse(path_.of(name), *field, fmt::format("a whole number from {} to {}", low, high));
    }
    value = field->get<std::size_t>();
  }

  void seed(std::uint64_t& value) override {
    const json* field = find("seed");
    if (field == nullptr) return;
    if (!field->is_number_unsigned()) {
      refuse(path_.of("seed"), *field, "a whole number from 0 to 2^64 - 1");
    }
    value = field->get<std::uint64_t>();
  }

  void color(std::string_view name, std::array<float, 3>& value,
             std::string_view /*meaning*/) override {
    const json* field = find(name);
    if (field == nullptr) return;
    const std::string path = path_.of(name);
    if (!field->is_array() || field->size() != 3) refuse(path, *field, "3 numbers");
    for (std::size_t i = 0; i < 3; ++i) {
      value[i] = static_cast<float>(number_of((*field)[i], fmt::format("{}[{}]", path, i), 0, 1));
    }
  }

  void tile(std::array<double, 2>& value, double low, double high,
            std::string_view /*meaning*/) override {
    const json* field = find("tile");
    if (field == nullptr) return;
    if (!field->is_array() || field->size() != 2) refuse(path_.of("tile"), *field, "2 numbers");
    for (std::size_t i = 0; i < 2; ++i) {
      value[i] = number_of((*field)[i], fmt::format("{}[{}]", path_.of("tile"), i), low, high);
    }
  }

  void open(std::string_view name, std::string_view /*meaning*/) override {
    const json* field = find(name);
    if (field != nullptr && !field->is_object()) refuse(path_.of(name), *field, "an object");
    path_.push(name);
    levels_.push_back({field, {}});
  }

  std::size_t open_list(std::string_view name, std::size_t size, std::size_t least,
                        std::size_t most, std::string_view /*meaning*/) override {
    const json* field = find(name);
    if (field != nullptr) {
      if (!field->is_array()) refuse(path_.of(name), *field, "a list of objects");
      size = field->size();
      if (size < least || size > most) {
        fail_input("{}: {} has {} entries, not {} to {}", where_, path_.of(name), size, least,
                   most);
      }
    }
    path_.push(name);
    levels_.push_back({field, {}});
    return size;
  }

  void open_item(std::size_t index) override {
    const json* const list = levels_.back().value;
    const json* const field = list == nullptr ? nullptr : &(*list)[index];
    path_.push(index);
    if (field != nullptr && !field->is_object()) refuse(path_.text(), *field, "an object");
    levels_.push_back({field, {}});
  }

  void close() override {
    finish();
    levels_.pop_back();
    path_.pop();
  }

  // The text of a field, which counts as known; empty where there is none.
  std::string text(const char* name) {
    const json* field = find(name);
    if (field == nullptr) return {};
    if (!field->is_string()) refuse(path_.of(name), *field, "a text");
    return field->get<std::string>();
  }

  // Refuses fields of the object at hand that nobody asked for.
  void finish() const {
    const Level& level = levels_.back();
    if (level.value == nullptr || !level.value->is_object()) return;
    for (const auto& [name, value] : level.value->items()) {
      if (level.known.contains(name)) continue;
      fail_input("{}: unknown field {}; known here: {}", where_, shown(path_.of(name)),
                 fmt::join(level.known, ", "));
    }
  }

 private:
  struct Level {
    const json* value;
    std::set<std::string> known;
  };

  const json* find(std::string_view name) {
    Level& level = levels_.back();
    const std::string key(name);
    level.known.insert(key);
    if (level.value == nullptr) return nullptr;
    const auto field = level.value->find(key);
    return field == level.value->end() ? nullptr : &*field;
  }

  double number_of(const json& field, const std::string& path, double low, double high) const {
    if (!field.is_number()) refuse(path, field, "a number");
    const auto value = field.get<double>();
    if (!(value >= low && value <= high)) {
      fail_input("{}: {} is {}, outside [{}, {}]", where_, path, value, low, high);
    }
    return value;
  }

  [[noreturn]] void refuse(const std::string& path, const json& value,
                           const std::string& wanted) const {
    fail_input("{}: {} is {}, not {}", where_, path, shown(value.dump()), wanted);
  }

  std::string where_;
  FieldPath path_;
  std::vector<Level> levels_;
};

}  // namespace

Material parse_material(std::string_view text, std::string_view where) {
  const json root = parse_json(text, where);
  if (!root.is_object()) fail_input("{}: not a JSON object", where);
  FieldReader reader(root, where);
  Material material;
  const std::string kind_name = reader.text("kind");
  material.summary = reader.text("summary");
  for (MaterialKind& kind : kinds_of_material()) {
    if (kind.name != kind_name) continue;
    std::visit([&reader](auto& parameters) { describe(reader, parameters); }, kind.standard);
    reader.finish();
    material.geometry = std::move(kind.standard);
    return material;
  }
  fail_input("{}: kind is '{}', not one of {}", where, shown(kind_name),
             fmt::join(material_kinds(), ", "));
}

}  // namespace weft
