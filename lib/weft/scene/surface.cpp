#include "weft/scene/surface.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "weft/error.hpp"

namespace weft {
namespace {

// Bounds the steps of a ray that is marched cell by cell.
constexpr double largest_range_in_cells = 16384;

// Keeps x + 1 of any wrapped sample and the size of a table well inside 32 bits.
constexpr std::size_t largest_side = 8192;

void check_side(std::size_t side, const char* field) {
  if (side < 1 || side > largest_side || !std::has_single_bit(side)) {
    fail_input("surface: {} is {}, not a power of two from 1 to {}", field, side, largest_side);
  }
}

void check_count(std::size_t count, std::size_t expected, const char* field) {
  if (count != expected) {
    fail_input("surface: {} has {} entries instead of {}", field, count, expected);
  }
}

// Written so that NaN fails.
void check_range(float value, float low, float high, const char* field, std::size_t index) {
  if (!(value >= low && value <= high)) {
    fail_input("surface: {} {} is {}, outside [{}, {}]", field, index, value, low, high);
  }
}

}  // namespace

Surface make_flat_surface(std::size_t columns, std::size_t rows, double width, double depth) {
  check_side(columns, "columns");
  check_side(rows, "rows");
  Surface surface;
  surface.columns = columns;
  surface.rows = rows;
  surface.width = width;
  surface.depth = depth;
  surface.elevation.resize(columns * rows);
  surface.samples.resize(columns * rows);
  surface.colors.resize(columns * rows);
  surface.lobes.resize(1);
  return surface;
}

void finish_surface(Surface& surface) {
  const std::size_t columns = surface.columns, rows = surface.rows;
  const std::vector<float>& z = surface.elevation;
  const auto [low, high] = std::minmax_element(z.begin(), z.end());
  surface.lowest = *low;
  surface.highest = *high;
  surface.reference =
      static_cast<float>(std::accumulate(z.begin(), z.end(), 0.0) / static_cast<double>(z.size()));
  // Rounding must not put the mean of a level surface above or below it.
  surface.reference = std::clamp(surface.reference, surface.lowest, surface.highest);

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
      SurfaceSample& sample = surface.samples[r * columns + c];
      sample.normal_x = static_cast<float>(-slope_x / length);
      sample.normal_y = static_cast<float>(-slope_y / length);
    }
  }
}

void validate(const Surface& surface) {
  check_side(surface.columns, "columns");
  check_side(surface.rows, "rows");
  const std::size_t count = surface.columns * surface.rows;
  check_count(surface.elevation.size(), count, "elevation");
  check_count(surface.samples.size(), count, "samples");
  check_count(surface.colors.size(), count, "colors");
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
    for (const float f0 : lobe.f0) check_range(f0, 0, 1, "f0 of lobe", i);
    check_range(lobe.f90, 0, 1, "f90 of lobe", i);
    check_range(lobe.alpha_along, 1e-3f, 1, "alpha_along of lobe", i);
    check_range(lobe.alpha_across, 1e-3f, 1, "alpha_across of lobe", i);
  }
  const auto last_lobe = static_cast<float>(surface.lobes.size() - 1);
  for (std::size_t i = 0; i < count; ++i) {
    check_range(surface.elevation[i], surface.lowest, surface.highest, "elevation", i);
    const SurfaceSample& sample = surface.samples[i];
    check_range(std::hypot(sample.normal_x, sample.normal_y), 0, 1.00001f, "normal", i);
    check_range(std::hypot(sample.fibre_x, sample.fibre_y), 0.99f, 1.01f, "fibre", i);
    const SurfaceColor& color = surface.colors[i];
    for (const float albedo : color.albedo) check_range(albedo, 0, 1, "albedo", i);
    check_range(color.lobe, 0, last_lobe, "lobe", i);
    if (color.lobe != std::floor(color.lobe)) {
      fail_input("surface: lobe {} is {}, not a whole number", i, color.lobe);
    }
  }
}

}  // namespace weft
