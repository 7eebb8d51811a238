#include "weft/scene/material.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>

#include "weft/error.hpp"
#include "weft/io/fixed_view.hpp"
#include "weft/io/json_text.hpp"
#include "weft/scene/material_kinds.hpp"

namespace weft {
namespace {

// A tile is lengthened at most by this; images longer than that show it drawn out.
constexpr double most_stretch = 16;

}  // namespace

std::uint64_t Material::seed() const {
  return std::visit([](const auto& parameters) { return parameters.seed; }, geometry);
}

void Material::set_seed(std::uint64_t seed) {
  std::visit([seed](auto& parameters) { parameters.seed = seed; }, geometry);
}

std::vector<std::string_view> material_kinds() {
  std::vector<std::string_view> names;
  for (const MaterialKind& kind : kinds_of_material()) names.push_back(kind.name);
  return names;
}

std::vector<FieldRow> material_fields(std::string_view name, std::string_view where) {
  for (MaterialKind& kind : kinds_of_material()) {
    if (kind.name != name) continue;
    FieldLister lister;
    std::visit([&lister](auto& parameters) { describe(lister, parameters); }, kind.standard);
    return lister.rows();
  }
  fail_input("{}: '{}' is no kind of material; known: {}", where, shown(name),
             fmt::join(material_kinds(), ", "));
}

const MaterialPreset& find_preset(std::string_view name, std::string_view option) {
  std::vector<std::string_view> names;
  for (const MaterialPreset& preset : material_presets()) {
    if (preset.name == name) return preset;
    names.emplace_back(preset.name);
  }
  fail_input("{}: '{}' is neither a preset nor a file NAME.json; presets: {}", option, shown(name),
             fmt::join(names, ", "));
}

Material find_material(const std::string& name_or_file, std::string_view option) {
  const std::filesystem::path path(name_or_file);
  if (path.extension() == ".json") {
    Material material = parse_material(read_text(path), name_or_file);
    material.name = path.stem().string();
    return material;
  }
  const MaterialPreset& preset = find_preset(name_or_file, option);
  Material material = parse_material(preset.text, name_or_file + ".json");
  material.name = preset.name;
  return material;
}

std::size_t SurfaceExtent::bytes() const {
  const std::size_t of_layer = sizeof(float) + sizeof(SurfaceSample) + sizeof(SurfaceColor);
  return cells() * (layers * of_layer + undersides * sizeof(float));
}

SurfaceExtent surface_extent(const Material& material, std::size_t width, std::size_t height) {
  const std::size_t resolution = surface_resolution(std::max(width, height));
  SurfaceExtent extent{resolution, resolution};
  if (const Knit* const knit = std::get_if<Knit>(&material.geometry)) {
    extent.layers = extent.undersides = knit_layers(*knit);
  } else if (std::holds_alternative<Coins>(material.geometry)) {
    extent.layers = coin_layers;
    extent.undersides = coin_layers - 1;  // the lowest is solid
  } else if (std::holds_alternative<Net>(material.geometry)) {
    extent.undersides = 1;
  }
  return extent;
}

Surface make_surface(const Material& material, std::size_t width, std::size_t height) {
  const double aspect = std::clamp(static_cast<double>(width) / static_cast<double>(height),
                                   1 / most_stretch, most_stretch);
  const std::size_t resolution = surface_resolution(std::max(width, height));
  return std::visit(
      [&](auto parameters) {
        if (aspect != 1) stretch(parameters, std::max(1.0, aspect), std::max(1.0, 1 / aspect));
        return make_surface(parameters, resolution, resolution);
      },
      material.geometry);
}

}  // namespace weft
