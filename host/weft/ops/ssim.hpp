// Structural similarity of decoded tiles: kernels/ssim.cl.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/ops/tile.hpp"

namespace weft::ops {

// SSIM (weft/metrics/ssim.hpp) of each image of a decoded tile (float, [images][Y][X][C]) to the
// raw one, `width` texels wide, with the given peak. Throws an input error if the images are
// smaller than the window or the peak is not positive. Waits for the device.
std::vector<double> ssim(Device& device, const TileShape& tile, std::size_t width,
                         const Buffer& raw, const Buffer& decoded, double peak);

}  // namespace weft::ops
