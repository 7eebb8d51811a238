#include "weft/render/device_surface.hpp"

#include <algorithm>
#include <array>
#include <span>

#include "weft/ops/launch.hpp"
#include "weft/reference/surface_march.hpp"

namespace weft {
namespace {

using Quad = std::array<float, 4>;  // a cell's corners

// Appends the quads of a table of samples.
void add_quads(const Surface& surface, const std::vector<float>& table, std::vector<Quad>& quads) {
  const std::size_t columns = surface.columns, rows = surface.rows;
  for (std::size_t r = 0; r < rows; ++r) {
    const float* const here = &table[r * columns];
    const float* const above = &table[(r + 1) % rows * columns];
    for (std::size_t c = 0; c < columns; ++c) {
      const std::size_t next = (c + 1) % columns;
      quads.push_back({here[c], here[next], above[c], above[next]});
    }
  }
}

template <typename Value>
Buffer upload(Device& device, const std::vector<Value>& values, const char* name) {
  Buffer buffer(device, values.size() * sizeof(Value), name);
  device.write(buffer, std::span<const Value>(values));
  return buffer;
}

Buffer upload_heights(Device& device, const Surface& surface) {
  std::size_t tables = surface.layers.size();
  for (const SurfaceLayer& layer : surface.layers) tables += layer.underside.empty() ? 0 : 1;
  std::vector<Quad> quads;
  quads.reserve(tables * surface.columns * surface.rows);
  for (const SurfaceLayer& layer : surface.layers) add_quads(surface, layer.elevation, quads);
  for (const SurfaceLayer& layer : surface.layers) {
    if (!layer.underside.empty()) add_quads(surface, layer.underside, quads);
  }
  return upload(device, quads, "elevations and undersides");
}

// The tables of all layers, one after another.
template <typename Value>
Buffer upload_layers(Device& device, const Surface& surface,
                     std::vector<Value> SurfaceLayer::*table, const char* name) {
  static_assert(sizeof(Value) == 4 * sizeof(float), "read as float4");
  std::vector<Value> values;
  values.reserve(surface.layers.size() * surface.columns * surface.rows);
  for (const SurfaceLayer& layer : surface.layers) {
    values.insert(values.end(), (layer.*table).begin(), (layer.*table).end());
  }
  return upload(device, values, name);
}

std::vector<float> packed_lobes(const Surface& surface) {
  std::vector<float> lobes;
  for (const GlossyLobe& lobe : surface.lobes) {
    lobes.insert(lobes.end(), {lobe.f0[0], lobe.f0[1], lobe.f0[2], lobe.f90, lobe.alpha_along,
                               lobe.alpha_across, 0, 0});
  }
  return lobes;
}

std::string options_of(const Device& device, const Surface& surface) {
  unsigned undersides = 0;
  for (std::size_t l = 0; l < surface.layers.size(); ++l) {
    if (!surface.layers[l].underside.empty()) undersides |= 1u << l;
  }
  return "-DVW=" + std::to_string(ops::vector_width(device)) +
         " -DLAYERS=" + std::to_string(surface.layers.size()) +
         " -DUNDERSIDES=" + std::to_string(undersides) +
         " -DBLOCK_BITS=" + std::to_string(block_bits) +
         " -DBISECTIONS=" + std::to_string(ray_bisections);
}

}  // namespace

std::vector<float> surface_ceilings(const Surface& surface) {
  const std::size_t columns = surface.columns, rows = surface.rows;
  const std::size_t side = std::size_t{1} << block_bits;
  const std::size_t across = (columns + side - 1) / side, along = (rows + side - 1) / side;
  // Of every row, over the columns of a block and round it.
  std::vector<float> row_tops(rows * across, surface.lowest);
  for (const SurfaceLayer& layer : surface.layers) {
    for (std::size_t r = 0; r < rows; ++r) {
      const float* const row = &layer.elevation[r * columns];
      for (std::size_t block = 0; block < across; ++block) {
        float& top = row_tops[r * across + block];
        for (std::size_t i = 0; i < 3 * side + 2; ++i) {
          // Whole periods keep the number positive.
          const std::size_t c = block * side + i + 2 * side * columns - side - 1;
          top = std::max(top, row[c % columns]);
        }
      }
    }
  }
  std::vector<float> ceilings(along * across, surface.lowest);
  for (std::size_t band = 0; band < along; ++band) {
    for (std::size_t i = 0; i < 3 * side + 2; ++i) {
      const std::size_t r = (band * side + i + 2 * side * rows - side - 1) % rows;
      for (std::size_t block = 0; block < across; ++block) {
        float& top = ceilings[band * across + block];
        top = std::max(top, row_tops[r * across + block]);
      }
    }
  }
  return ceilings;
}

std::size_t DeviceSurface::cell_bytes(std::size_t layers, std::size_t undersides) {
  return (layers + undersides) * sizeof(Quad) +
         layers * (sizeof(SurfaceSample) + sizeof(SurfaceColor)) + sizeof(float);
}

std::size_t DeviceSurface::copied_cell_bytes(std::size_t layers, std::size_t undersides) {
  return (layers + undersides) * sizeof(Quad);
}

DeviceSurface::DeviceSurface(Device& device, const Surface& surface)
    : heights_(upload_heights(device, surface)),
      ceilings_(upload(device, surface_ceilings(surface), "highest elevations of blocks")),
      shape_(upload_layers(device, surface, &SurfaceLayer::samples, "normals and fibres")),
      color_(upload_layers(device, surface, &SurfaceLayer::colors, "colours")),
      lobes_(upload(device, packed_lobes(surface), "lobes")),
      build_options_(options_of(device, surface)) {}

}  // namespace weft
