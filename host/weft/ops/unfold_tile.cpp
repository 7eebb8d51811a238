#include "weft/ops/unfold_tile.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {

void unfold_tile(Device& device, const UnfoldShape& shape, const Buffer& raw, float scale,
                 Buffer& tile) {
  constexpr std::size_t texels_of_item = 1024;
  const cl_kernel kernel =
      device.kernel(kernel_sources::unfold_tile,
                    fmt::format("{} {} -DCHANNELS={} -DCHANNELS_FIRST={} -DTEXELS={}",
                                vector_option(device), value_options(shape.dtype, shape.nan_zero),
                                shape.channels, shape.channels_first ? 1 : 0, texels_of_item),
                    "unfold_tile");
  set_arguments(kernel, raw, ulong(shape.raw_texels), ulong(shape.first), ulong(shape.texels),
                scale, tile);
  launch_items(device, kernel, ceil_div(shape.texels, texels_of_item), shape.images);
}

}  // namespace weft::ops
