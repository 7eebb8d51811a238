#include "weft/model/material_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using nlohmann::json;

constexpr std::size_t longest_name = 64;
// What the entries of a file say of each tensor, material or not.
constexpr const char* tensor_metadata[] = {"checksums", "coded"};
// What materials have in common.
constexpr const char* shared_metadata[] = {"weft.format", "codec", "storage"};

std::string field_of(const SafetensorsFile& file, std::string_view key) {
  return fmt::format("{}: metadata \"{}\"", file.path().string(), key);
}

// Whether materials have tensors of that name of their own.
bool is_own(std::string_view tensor) {
  return tensor.starts_with("P6") || tensor.starts_with("view_directions") ||
         tensor.starts_with("light_directions") || tensor.starts_with("mask");
}

std::string_view owner_of(std::string_view tensor) {
  const std::size_t slash = tensor.find('/');
  return slash == std::string_view::npos ? std::string_view() : tensor.substr(0, slash);
}

// The name that a tensor of the file has in a material's part; none where it has no part in it.
std::optional<std::string> name_in_part(std::string_view tensor, std::string_view material) {
  const std::string_view owner = owner_of(tensor);
  if (owner.empty()) return std::string(tensor);
  if (owner != material) return std::nullopt;
  return std::string(tensor.substr(owner.size() + 1));
}

// A JSON object by tensors, with those of the part alone.
std::string object_of_part(const SafetensorsFile& file, const char* key,
                           std::string_view material) {
  const json whole = parse_json(file.value(key), field_of(file, key));
  if (!whole.is_object()) fail_input("{}: no JSON object", field_of(file, key));
  json part = json::object();
  for (const auto& [tensor, value] : whole.items()) {
    if (const std::optional<std::string> name = name_in_part(tensor, material)) part[*name] = value;
  }
  return part.dump();
}

std::string names_of(std::span<const MaterialEntry> materials) {
  std::string names;
  for (const MaterialEntry& material : materials) {
    names += fmt::format("{}{}", names.empty() ? "" : ", ", material.name);
  }
  return names;
}

// Tensors and checksums are of materials that are listed, and those that are to be shared of none.
void check_tensors(const SafetensorsFile& file, const std::set<std::string, std::less<>>& names) {
  for (const TensorInfo& tensor : file.tensors()) {
    const std::string_view owner = owner_of(tensor.name);
    const bool shared = tensor.name.find('/') == std::string::npos;
    if (!shared && !names.contains(owner)) {
      fail_input("{}: tensor \"{}\" is of no material that is listed", file.path().string(),
                 shown(tensor.name));
    }
    const std::string_view name = shared ? std::string_view(tensor.name)
                                         : std::string_view(tensor.name).substr(owner.size() + 1);
    if (is_own(name) == shared) {
      fail_input("{}: tensor \"{}\" {}", file.path().string(), shown(tensor.name),
                 shared ? "is of no material" : "is one material's, but to be shared by all");
    }
  }
  for (const char* key : tensor_metadata) {
    if (file.metadata().count(key) == 0) continue;
    const json object = parse_json(file.value(key), field_of(file, key));
    if (!object.is_object()) fail_input("{}: no JSON object", field_of(file, key));
    for (const auto& [name, value] : object.items()) {
      if (file.find(name) == nullptr) {
        fail_input("{}: no tensor \"{}\"", field_of(file, key), shown(name));
      }
    }
  }
}

}  // namespace

MaterialPath material_path(const std::filesystem::path& path) {
  constexpr std::string_view ending = ".weft:";
  const std::string text = path.string();
  const std::size_t at = text.rfind(ending);
  std::error_code ignored;
  if (at == std::string::npos || std::filesystem::exists(path, ignored)) return {path, ""};
  const std::size_t colon = at + ending.size() - 1;
  return {text.substr(0, colon), text.substr(colon + 1)};
}

void check_material_name(std::string_view name, std::string_view where) {
  const bool known = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string_view("._-+").find(c) != std::string_view::npos;
  });
  if (name.empty() || name.size() > longest_name || !known) {
    fail_input("{}: a material's name has 1 to {} letters, digits and . _ - +, not '{}'", where,
               longest_name, shown(name));
  }
}

std::string materials_json(std::span<const MaterialEntry> materials) {
  json list = json::array();
  for (const MaterialEntry& material : materials) {
    json object = json(material.metadata);
    object["name"] = material.name;
    list.push_back(std::move(object));
  }
  return list.dump();
}

std::vector<MaterialEntry> read_materials(const SafetensorsFile& file) {
  if (file.metadata().count("materials") == 0) return {};
  const std::string where = field_of(file, "materials");
  const json list = parse_json(file.value("materials"), where);
  if (!list.is_array() || list.empty()) fail_input("{}: no list of materials", where);
  std::vector<MaterialEntry> materials;
  std::set<std::string, std::less<>> names;
  for (const json& object : list) {
    const std::string entry = fmt::format("{}: material {}", where, materials.size());
    if (!object.is_object()) fail_input("{}: no JSON object", entry);
    MaterialEntry material;
    for (const auto& [key, value] : object.items()) {
      if (!value.is_string()) fail_input("{}: \"{}\" is no text", entry, shown(key));
      material.metadata[key] = value.get<std::string>();
    }
    material.name = material.metadata["name"];
    material.metadata.erase("name");
    check_material_name(material.name, entry);
    if (!names.insert(material.name).second) {
      fail_input("{}: there are two materials named '{}'", where, material.name);
    }
    materials.push_back(std::move(material));
  }
  check_tensors(file, names);
  return materials;
}

SafetensorsFile material_part(const SafetensorsFile& file, const MaterialEntry& material) {
  Metadata metadata = material.metadata;
  for (const char* key : shared_metadata) metadata[key] = file.require(key);
  for (const char* key : tensor_metadata) {
    metadata.erase(key);
    if (file.metadata().count(key) != 0) {
      metadata[key] = object_of_part(file, key, material.name);
    }
  }
  return file.part(file.path().string() + ":" + material.name, std::move(metadata),
                   [&](std::string_view tensor) { return name_in_part(tensor, material.name); });
}

std::shared_ptr<const SafetensorsFile> open_material(const std::filesystem::path& path) {
  const MaterialPath wanted = material_path(path);
  auto file = std::make_shared<SafetensorsFile>(wanted.file);
  const std::vector<MaterialEntry> materials = read_materials(*file);
  const std::string where = wanted.file.string();
  if (materials.empty()) {
    if (wanted.name.empty()) return file;
    fail_input("{}: a model, no data base with a material '{}'", where, shown(wanted.name));
  }
  if (wanted.name.empty() && materials.size() > 1) {
    fail_input("{}: a data base of {} materials: name one of {}, as {}:{}", where, materials.size(),
               names_of(materials), where, materials.front().name);
  }
  for (const MaterialEntry& material : materials) {
    if (!wanted.name.empty() && material.name != wanted.name) continue;
    return std::make_shared<SafetensorsFile>(material_part(*file, material));
  }
  fail_input("{}: a data base without a material '{}'; it has {}", where, shown(wanted.name),
             names_of(materials));
}

}  // namespace weft
