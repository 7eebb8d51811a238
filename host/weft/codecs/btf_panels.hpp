// The texel x (view, light, channel) unfolding A of a BTF, its mean removed, as a stream of panels:
// A^T by runs of images, or A by blocks of texels.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/codecs/panel_stream.hpp"
#include "weft/job.hpp"

namespace weft {

// Rows of X: `images` streams X = A^T, K = n rows of m = P texels; `texels` streams X = A, K = P
// rows of m = n image channels.
enum class StreamedRows { images, texels };

// `mean` holds n values; `scale` is a power of two. Source and job must outlive the stream.
std::unique_ptr<PanelStream> btf_panels(Device& device, TileSource& source, StreamedRows rows,
                                        Arithmetic arithmetic, std::span<const float> mean,
                                        float scale, const Job& job);

// Rows of a block, and bytes that such a stream holds in a pass.
std::size_t panel_granule(const BtfShape& shape, StreamedRows rows);
std::size_t btf_panels_bytes(Device& device, TileSource& source, StreamedRows rows,
                             Arithmetic arithmetic);

}  // namespace weft
