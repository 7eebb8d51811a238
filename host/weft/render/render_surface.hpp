// Renders a periodic height field, as woven cloth is one, into a BTF on a device
// (kernels/render_surface.cl). The formula and its conventions stand in
// weft/reference/render_surface.hpp.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/reference/render_surface.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

// A surface in device memory.
class DeviceSurface {
 public:
  // Copies a surface that `validate` accepts.
  DeviceSurface(Device& device, const Surface& surface);

  const Buffer& elevation() const { return elevation_; }
  const Buffer& shape() const { return shape_; }
  const Buffer& color() const { return color_; }
  const Buffer& lobes() const { return lobes_; }

 private:
  Buffer elevation_, shape_, color_, lobes_;
};

// A band: whole rows of an image, or a part of one row.
struct TexelBand {
  std::size_t first_row = 0, rows = 1;
  std::size_t first_column = 0, columns = 1;
  std::size_t texels() const { return rows * columns; }
  bool operator==(const TexelBand&) const = default;
};

// Bytes of surface_hits' output per texel and sample.
inline constexpr std::size_t surface_hit_bytes = 13 * sizeof(float);

// Traces the view rays of a band of texels. hits: band.texels() * samples records.
void launch_surface_hits(Device& device, const Surface& surface, const DeviceSurface& tables,
                         const BtfInfo& info, const SurfaceRenderOptions& options, std::size_t view,
                         TexelBand band, Buffer& hits);

// The lights [first, first + count) as surface_shade reads them, in chunks of eight.
std::vector<float> pack_surface_lights(const Surface& surface, const BtfInfo& info,
                                       std::size_t first, std::size_t count);

// Shades the hits of a band under `light_count` packed lights. out: [light][texel][3] in
// info.dtype.
void launch_surface_shade(Device& device, const Surface& surface, const DeviceSurface& tables,
                          const BtfInfo& info, const SurfaceRenderOptions& options,
                          std::size_t view, TexelBand band, const Buffer& hits,
                          const Buffer& lights, std::size_t light_count, Buffer& out);

// Renders all images that sink.info() asks for, and finishes the sink. Holds runs of images within
// options.tile_bytes; values do not depend on how many that is. Writing one run and rendering the
// next overlap.
void render_surface(Device& device, const Surface& surface, const SurfaceRenderOptions& options,
                    TileSink& sink);

}  // namespace weft
