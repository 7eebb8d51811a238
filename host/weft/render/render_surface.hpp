// Renders a surface of layers into a BTF on a device (kernels/render_surface.cl). The formula and
// its conventions stand in weft/reference/render_surface.hpp.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/reference/render_surface.hpp"
#include "weft/render/device_surface.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

// A band: whole rows of an image, or a part of one row.
struct TexelBand {
  std::size_t first_row = 0, rows = 1;
  std::size_t first_column = 0, columns = 1;
  std::size_t texels() const { return rows * columns; }
  bool operator==(const TexelBand&) const = default;
};

// Bytes of surface_hits' output per texel and sample.
inline constexpr std::size_t surface_hit_bytes = 13 * sizeof(float);
// And of surface_bounce's.
inline constexpr std::size_t surface_bounce_bytes = 9 * sizeof(float);

// Traces the view rays of a band of texels. hits: band.texels() * samples records.
void launch_surface_hits(Device& device, const Surface& surface, const DeviceSurface& tables,
                         const BtfInfo& info, const SurfaceRenderOptions& options, std::size_t view,
                         TexelBand band, Buffer& hits);

// Traces one more ray from each hit of a band. bounces: as many records.
void launch_surface_bounce(Device& device, const Surface& surface, const DeviceSurface& tables,
                           const BtfInfo& info, const SurfaceRenderOptions& options,
                           std::size_t view, TexelBand band, const Buffer& hits, Buffer& bounces);

// The lights [first, first + count) as surface_shade reads them on this device, in chunks as wide
// as its vectors.
std::vector<float> pack_surface_lights(const Device& device, const Surface& surface,
                                       const BtfInfo& info, std::size_t first, std::size_t count);

// Shades the hits of a band, and where options.bounces is 1 their bounces, under `light_count`
// packed lights. out: [light][texel][3] in info.dtype.
void launch_surface_shade(Device& device, const Surface& surface, const DeviceSurface& tables,
                          const BtfInfo& info, const SurfaceRenderOptions& options,
                          std::size_t view, TexelBand band, const Buffer& hits,
                          const Buffer& bounces, const Buffer& lights, std::size_t light_count,
                          Buffer& out);

// Tells which view rays of an image of width x height texels, one sample each, meet material.
// mask: [height][width] bytes.
void launch_surface_mask(Device& device, const Surface& surface, const DeviceSurface& tables,
                         const BtfInfo& info, const SurfaceRenderOptions& options, std::size_t view,
                         std::size_t width, std::size_t height, Buffer& mask);

// The most that one run of images in the making takes besides, in units of options.tile_bytes.
inline constexpr std::size_t surface_tiles = 5;

// Fills info.mask and info.mask_distance as render_surface_mask_reference does.
void render_surface_mask(Device& device, const Surface& surface,
                         const SurfaceRenderOptions& options, BtfInfo& info);

// Renders all images that sink.info() asks for, and finishes the sink. Holds runs of images within
// options.tile_bytes; values do not depend on how many that is. Writing one run and rendering the
// next overlap.
void render_surface(Device& device, const Surface& surface, const SurfaceRenderOptions& options,
                    TileSink& sink);

}  // namespace weft
