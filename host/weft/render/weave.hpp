// Renders a periodic height field, as woven cloth is one, into a BTF on a device
// (kernels/weave.cl). The formula and its conventions stand in weft/reference/weave.hpp.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/reference/weave.hpp"
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

// Bytes of weave_hits' output per texel and sample.
inline constexpr std::size_t weave_hit_bytes = 13 * sizeof(float);

// Traces the view rays of a band of texels. hits: band.texels() * samples records.
void launch_weave_hits(Device& device, const Surface& surface, const DeviceSurface& tables,
                       const BtfInfo& info, const WeaveRenderOptions& options, std::size_t view,
                       TexelBand band, Buffer& hits);

// The lights [first, first + count) as weave_shade reads them, in chunks of eight.
std::vector<float> pack_weave_lights(const Surface& surface, const BtfInfo& info, std::size_t first,
                                     std::size_t count);

// Shades the hits of a band under `light_count` packed lights. out: [light][texel][3] in
// info.dtype.
void launch_weave_shade(Device& device, const Surface& surface, const DeviceSurface& tables,
                        const BtfInfo& info, const WeaveRenderOptions& options, std::size_t view,
                        TexelBand band, const Buffer& hits, const Buffer& lights,
                        std::size_t light_count, Buffer& out);

// Renders all images that sink.info() asks for, and finishes the sink. Holds runs of images within
// options.tile_bytes; values do not depend on how many that is. Writing one run and rendering the
// next overlap.
void render_weave(Device& device, const Surface& surface, const WeaveRenderOptions& options,
                  TileSink& sink);

}  // namespace weft
