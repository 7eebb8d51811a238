// The library of simulated materials: presets, which are JSON files, and the makers of geometry
// that they name. docs/materials.md describes the fields.
//
//   {"kind": "leather", "summary": "brown leather, ...", "seed": 1, "tile": [24, 24], ...}
//
// `kind` is required and chooses the maker; a field that is left out keeps its default.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "weft/scene/coins.hpp"
#include "weft/scene/corduroy.hpp"
#include "weft/scene/fields.hpp"
#include "weft/scene/gravel.hpp"
#include "weft/scene/hammered_metal.hpp"
#include "weft/scene/knit.hpp"
#include "weft/scene/leather.hpp"
#include "weft/scene/net.hpp"
#include "weft/scene/surface.hpp"
#include "weft/scene/weave.hpp"

namespace weft {

using MaterialGeometry =
    std::variant<WeaveCloth, Knit, Corduroy, Leather, HammeredMetal, Gravel, Coins, Net>;

struct Material {
  std::string name;     // of the preset, or the file
  std::string summary;  // one line
  MaterialGeometry geometry;

  std::uint64_t seed() const;
  void set_seed(std::uint64_t seed);
};

// A preset that comes with the library, as its file has it.
struct MaterialPreset {
  const char* name;
  const char* text;
};
std::span<const MaterialPreset> material_presets();

// "weave", "corduroy", ...: what `kind` may be.
std::vector<std::string_view> material_kinds();

// The fields of a kind with their ranges and defaults. Throws an input error for an unknown kind;
// `where` names the request.
std::vector<FieldRow> material_fields(std::string_view kind, std::string_view where);

// Reads a material from JSON. Throws an input error that names `where`, the path of the field and
// its value for whatever is not as described.
Material parse_material(std::string_view text, std::string_view where);

// The preset of that name, or the material of a file whose name ends in .json. `option` names the
// request in messages.
Material find_material(const std::string& name_or_file, std::string_view option);
const MaterialPreset& find_preset(std::string_view name, std::string_view option);

// What a surface holds at most: known before it is made.
struct SurfaceExtent {
  std::size_t columns = 0, rows = 0;
  std::size_t layers = 1;
  std::size_t undersides = 0;  // of the layers

  std::size_t cells() const { return columns * rows; }
  // Of its tables in memory.
  std::size_t bytes() const;
};
SurfaceExtent surface_extent(const Material& material, std::size_t width, std::size_t height);

// The surface for images of width x height texels, which show one tile. A square image shows the
// tile as it is; the longer side of any other shows a longer tile, so that texels stay square.
Surface make_surface(const Material& material, std::size_t width, std::size_t height);

}  // namespace weft
