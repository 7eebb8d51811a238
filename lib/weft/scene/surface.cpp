#include "weft/scene/surface.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "weft/error.hpp"

namespace weft {
namespace {

// Bounds the steps of a ray that is marched cell by cell.
constexpr double largest_range_in_cells = 16384;

// Keeps x + 1 of any wrapped sample and the size of a table well inside 32 bits.
constexpr std::size_t largest_side = 8192;

constexpr float infinity = std::numeric_limits<float>::infinity();

void check_side(std::size_t side, const char* field) {
  if (side < 1 || side > largest_side || !std::has_single_bit(side)) {
    fail_input("surface: {} is {}, not a power of two from 1 to {}", field, side, largest_side);
  }
}

void check_layers(std::size_t layers) {
  if (layers < 1 || layers > most_layers) {
    fail_input("surface: layers is {}, not from 1 to {}", layers, most_layers);
  }
}

// A field's name in a message: "elevation", or "elevation of layer 1" where there are several.
struct Field {
  const char* name;
  std::string_view owner = {};
};

void check_count(std::size_t count, std::size_t expected, Field field) {
  if (count != expected) {
    fail_input("surface: {}{} has {} entries instead of {}", field.name, field.owner, count,
               expected);
  }
}

// Written so that NaN fails.
void check_range(float value, float low, float high, Field field, std::size_t index) {
  if (!(value >= low && value <= high)) {
    fail_input("surface: {}{} {} is {}, outside [{}, {}]", field.name, field.owner, index, value,
               low, high);
  }
}

void check_elevations(const Surface& surface, const SurfaceLayer& layer, std::string_view owner) {
  const float low = surface.lowest, high = surface.highest, range = high - low;
  const Field elevation{"elevation", owner}, underside{"underside", owner};
  for (std::size_t i = 0; i < layer.elevation.size(); ++i) {
    if (layer.underside.empty()) {
      check_range(layer.elevation[i], low, high, elevation, i);
      continue;
    }
    const bool hole = layer.elevation[i] < layer.underside[i];
    check_range(layer.elevation[i], hole ? low - range : low, high, elevation, i);
    check_range(layer.underside[i], low, hole ? high + range : high, underside, i);
  }
}

void check_layer(const Surface& surface, std::size_t index) {
  const SurfaceLayer& layer = surface.layers[index];
  const std::size_t count = surface.columns * surface.rows;
  // Most surfaces have one layer, which needs no number.
  const std::string owner = surface.layers.size() == 1 ? "" : fmt::format(" of layer {}", index);
  check_count(layer.elevation.size(), count, {"elevation", owner});
  if (!layer.underside.empty()) check_count(layer.underside.size(), count, {"underside", owner});
  check_count(layer.samples.size(), count, {"samples", owner});
  check_count(layer.colors.size(), count, {"colors", owner});
  check_elevations(surface, layer, owner);
  const auto last_lobe = static_cast<float>(surface.lobes.size() - 1);
  for (std::size_t i = 0; i < count; ++i) {
    const SurfaceSample& sample = layer.samples[i];
    check_range(std::hypot(sample.normal_x, sample.normal_y), 0, 1.00001f, {"normal", owner}, i);
    check_range(std::hypot(sample.fibre_x, sample.fibre_y), 0.99f, 1.01f, {"fibre", owner}, i);
    const SurfaceColor& color = layer.colors[i];
    for (const float albedo : color.albedo) check_range(albedo, 0, 1, {"albedo", owner}, i);
    check_range(color.lobe, 0, last_lobe, {"lobe", owner}, i);
    if (color.lobe != std::floor(color.lobe)) {
      fail_input("surface: lobe{} {} is {}, not a whole number", owner, i, color.lobe);
    }
  }
}

// Fills in the normals of a table of elevations, by central differences.
void fill_normals(const Surface& surface, const std::vector<float>& z,
                  std::vector<SurfaceSample>& samples) {
  const std::size_t columns = surface.columns, rows = surface.rows;
  const double per_x = 0.5 * static_cast<double>(columns) / surface.width;
  const double per_y = 0.5 * static_cast<double>(rows) / surface.depth;
  for (std::size_t r = 0; r < rows; ++r) {
    const float* const here = &z[r * columns];
    const float* const above = &z[(r + 1) % rows * columns];
    const float* const below = &z[(r + rows - 1) % rows * columns];
    for (std::size_t c = 0; c < columns; ++c) {
      const double slope_x = per_x * (here[(c + 1) % columns] - here[(c + columns - 1) % columns]);
      const double slope_y = per_y * (above[c] - below[c]);
      const double length = std::sqrt(1 + slope_x * slope_x + slope_y * slope_y);
      SurfaceSample& sample = samples[r * columns + c];
      sample.normal_x = static_cast<float>(-slope_x / length);
      sample.normal_y = static_cast<float>(-slope_y / length);
    }
  }
}

}  // namespace

Surface make_flat_surface(std::size_t columns, std::size_t rows, double width, double depth,
                          std::size_t layers) {
  check_side(columns, "columns");
  check_side(rows, "rows");
  check_layers(layers);
  Surface surface;
  surface.columns = columns;
  surface.rows = rows;
  surface.width = width;
  surface.depth = depth;
  surface.layers.resize(layers);
  for (SurfaceLayer& layer : surface.layers) {
    layer.elevation.resize(columns * rows);
    layer.samples.resize(columns * rows);
    layer.colors.resize(columns * rows);
  }
  surface.lobes.resize(1);
  return surface;
}

void finish_surface(Surface& surface) {
  const std::size_t count = surface.columns * surface.rows;
  // Of every column, the highest material.
  std::vector<float> top(count, -infinity);
  surface.lowest = infinity;
  surface.highest = -infinity;
  for (SurfaceLayer& layer : surface.layers) {
    const bool solid = layer.underside.empty();
    for (std::size_t i = 0; i < count; ++i) {
      const float high = layer.elevation[i];
      const float low = solid ? high : layer.underside[i];
      if (high < low) continue;
      top[i] = std::max(top[i], high);
      surface.lowest = std::min(surface.lowest, low);
      surface.highest = std::max(surface.highest, high);
    }
    fill_normals(surface, layer.elevation, layer.samples);
  }
  double sum = 0;
  std::size_t covered = 0;
  for (const float z : top) {
    if (z == -infinity) continue;
    sum += z;
    ++covered;
  }
  if (covered == 0) fail_input("surface: no column holds material");
  surface.reference = static_cast<float>(sum / static_cast<double>(covered));
  // Rounding must not put the mean of a level surface above or below it.
  surface.reference = std::clamp(surface.reference, surface.lowest, surface.highest);
}

bool may_have_holes(const Surface& surface) {
  return std::none_of(surface.layers.begin(), surface.layers.end(),
                      [](const SurfaceLayer& layer) { return layer.underside.empty(); });
}

void validate(const Surface& surface) {
  check_side(surface.columns, "columns");
  check_side(surface.rows, "rows");
  check_layers(surface.layers.size());
  if (!(surface.width > 0 && std::isfinite(surface.width))) {
    fail_input("surface: width is {}, not a positive number", surface.width);
  }
  if (!(surface.depth > 0 && std::isfinite(surface.depth))) {
    fail_input("surface: depth is {}, not a positive number", surface.depth);
  }
  if (!(std::isfinite(surface.lowest) && std::isfinite(surface.highest) &&
        surface.lowest <= surface.reference && surface.reference <= surface.highest)) {
    fail_input("surface: reference elevation {} is not between lowest {} and highest {}",
               surface.reference, surface.lowest, surface.highest);
  }
  const double range = static_cast<double>(surface.highest) - surface.lowest;
  const double cells = range * std::max(static_cast<double>(surface.columns) / surface.width,
                                        static_cast<double>(surface.rows) / surface.depth);
  if (!(cells <= largest_range_in_cells)) {
    fail_input("surface: its elevations span {} cells, more than {}", cells,
               largest_range_in_cells);
  }
  if (surface.lobes.empty()) fail_input("surface: lobes has no entry");
  for (std::size_t i = 0; i < surface.lobes.size(); ++i) {
    const GlossyLobe& lobe = surface.lobes[i];
    for (const float f0 : lobe.f0) check_range(f0, 0, 1, {"f0 of lobe"}, i);
    check_range(lobe.f90, 0, 1, {"f90 of lobe"}, i);
    check_range(lobe.alpha_along, 1e-3f, 1, {"alpha_along of lobe"}, i);
    check_range(lobe.alpha_across, 1e-3f, 1, {"alpha_across of lobe"}, i);
  }
  for (std::size_t l = 0; l < surface.layers.size(); ++l) check_layer(surface, l);
}

}  // namespace weft
