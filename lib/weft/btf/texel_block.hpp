// Texels of all images of a source: what is needed where a job goes through a BTF texel by texel
// and not image by image.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"

namespace weft {

// Copies texels [first, first + count) of all images to `out`, [images][count][C] in the source's
// dtype, and releases the images. Of mapped images, and of sources that read parts, only these
// texels are touched; other images are read whole, one at a time.
void read_texels(TileSource& source, std::size_t first, std::size_t count,
                 std::span<std::byte> out);

// The same of one image, which is not released; `whole` is room for an image that can't be read in
// part.
void read_image_texels(TileSource& source, std::size_t image, std::size_t first, std::size_t count,
                       std::vector<std::byte>& whole, std::span<std::byte> out);

// The fixed block of texels that encoders go through such data in: as many as 8 MiB of floats
// hold. A function of the shape alone.
std::size_t texel_granule(const BtfShape& shape);

}  // namespace weft
