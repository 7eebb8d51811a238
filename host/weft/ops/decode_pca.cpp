#include "weft/ops/decode_pca.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t block_panels = 4;
constexpr std::size_t block_images = 16;
}  // namespace

void decode_pca(Device& device, const DecodePcaShape& shape, const Buffer& A, const Buffer& B,
                const Buffer& mean, Buffer& out) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::decode_pca,
                    fmt::format("{} -DCHANNELS={} -DPANELS={} -DIMAGES={}", vector_option(device),
                                shape.channels, block_panels, block_images),
                    "decode_pca");
  set_arguments(kernel, ulong(shape.texels), ulong(shape.first_image), ulong(shape.images),
                ulong(shape.rank), A, B, mean, out);
  launch_items(device, kernel, ceil_div(ceil_div(shape.texels, panel_width(device)), block_panels),
               ceil_div(shape.images, block_images));
}

}  // namespace weft::ops
