// Data bases: files of several materials that share tensors. The metadata `materials` is a JSON
// list of objects, each the metadata of a model as model_file.hpp has them, and its `name`. Tensors
// of a material have NAME/ in front of their names; those without are shared by all.
//
// FILE.weft:NAME names one material, which is opened like a model of its own.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/safetensors.hpp"

namespace weft {

// What FILE.weft:NAME says; `name` is empty where all of the text names a file.
struct MaterialPath {
  std::filesystem::path file;
  std::string name;
};
MaterialPath material_path(const std::filesystem::path& path);

// Throws an input error that begins with `where` unless it is of 1 to 64 letters, digits and . _ -
// and + of ASCII.
void check_material_name(std::string_view name, std::string_view where);

struct MaterialEntry {
  std::string name;
  Metadata metadata;
};

// The metadata `materials`, both ways.
std::string materials_json(std::span<const MaterialEntry> materials);
// None for a file that is no data base. Throws input errors for names that are none or there
// twice, tensors of materials that are not listed, and checksums of tensors that are not there.
std::vector<MaterialEntry> read_materials(const SafetensorsFile& file);

// One material, as a file of the tensors that are its own and of those that it shares.
SafetensorsFile material_part(const SafetensorsFile& file, const MaterialEntry& material);

// What a path names: a model, or a material of a data base, the only one where none is named.
// Throws an input error that lists the names.
std::shared_ptr<const SafetensorsFile> open_material(const std::filesystem::path& path);

}  // namespace weft
