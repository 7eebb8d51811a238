#include "weft/ops/decode_pca.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft {

namespace {
constexpr Tunable decode_pca_macros[] = {
    {"PANELS", 4, {1, 2, 4, 8, 16}, "panels that a work-item decodes"},
    {"IMAGES", 16, {4, 8, 16, 32, 64}, "images that it decodes them for"},
};
}  // namespace
constinit const TunableKernel tunables::decode_pca{"decode_pca", decode_pca_macros};

}  // namespace weft

namespace weft::ops {

void decode_pca(Device& device, const DecodePcaShape& shape, const Buffer& A, const Buffer& B,
                const Buffer& mean, Buffer& out) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::decode_pca,
                    fmt::format("{} {} -DCHANNELS={}", vector_option(device),
                                device.tuned_options(tunables::decode_pca), shape.channels),
                    "decode_pca");
  set_arguments(kernel, ulong(shape.texels), ulong(shape.first_image), ulong(shape.images),
                ulong(shape.rank), ulong(shape.first_out), A, B, mean, out);
  const std::size_t block_panels = device.parameter(tunables::decode_pca, "PANELS");
  const std::size_t block_images = device.parameter(tunables::decode_pca, "IMAGES");
  launch_items(device, kernel, ceil_div(ceil_div(shape.texels, panel_width(device)), block_panels),
               ceil_div(shape.images, block_images));
}

}  // namespace weft::ops
