// Raw texels as row-major tensors on the device: kernels/unfold_tile.cl.
#pragma once

#include <cstddef>

#include "weft/btf/btf.hpp"
#include "weft/device/device.hpp"

namespace weft::ops {

struct UnfoldShape {
  std::size_t images = 0;
  std::size_t raw_texels = 0;  // of each image in `raw`
  std::size_t first = 0;       // the texels that are taken
  std::size_t texels = 0;
  std::size_t channels = 0;
  DType dtype = DType::f32;
  bool nan_zero = false;
  bool channels_first = false;
};

// tile = T scale as floats, [images][texels][C], or [images][C][texels] with the channels first, of
// raw values [images][raw_texels][C]. `scale` must be a power of two.
void unfold_tile(Device& device, const UnfoldShape& shape, const Buffer& raw, float scale,
                 Buffer& tile);

}  // namespace weft::ops
