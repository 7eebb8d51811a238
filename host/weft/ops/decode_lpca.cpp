#include "weft/ops/decode_lpca.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <string>

#include "weft/ops/launch.hpp"

namespace weft {

namespace {
constexpr Tunable decode_lpca_macros[] = {
    {"PANELS", 4, {1, 2, 4, 8, 16}, "panels that a work-item decodes"},
    {"IMAGES", 16, {4, 8, 16, 32, 64}, "images that it decodes them for"},
    {"TEXELS", 4096, {512, 1024, 2048, 4096, 8192, 16384}, "texels that one puts in order"},
};
}  // namespace
constinit const TunableKernel tunables::decode_lpca{"decode_lpca", decode_lpca_macros};

}  // namespace weft

namespace weft::ops {

ClusterPanels cluster_panels(std::span<const std::uint32_t> clusters, std::size_t count,
                             std::size_t width) {
  ClusterPanels result;
  std::vector<std::size_t> sizes(count, 0);
  for (const std::uint32_t cluster : clusters) ++sizes[cluster];
  result.first.assign(1, 0);
  std::vector<std::size_t> next(count);  // a cluster's next free slot
  for (std::size_t g = 0; g < count; ++g) {
    next[g] = result.first.back() * width;
    result.first.push_back(result.first.back() + ceil_div(sizes[g], width));
    for (std::size_t done = 0; done < sizes[g]; done += width) {
      result.panels.push_back(static_cast<std::uint32_t>(g));
      result.panels.push_back(static_cast<std::uint32_t>(std::min(width, sizes[g] - done)));
    }
  }
  result.order.resize(result.count() * width);
  for (std::size_t p = 0; p < clusters.size(); ++p) {
    result.slots.push_back(static_cast<std::uint32_t>(next[clusters[p]]));
    result.order[next[clusters[p]]++] = static_cast<std::uint32_t>(p);
  }
  for (std::size_t g = 0; g < count; ++g) {
    for (; next[g] < result.first[g + 1] * width; ++next[g]) {
      result.order[next[g]] = result.order[next[g] - 1];
    }
  }
  return result;
}

std::size_t most_cluster_panels(std::size_t texels, std::size_t count, std::size_t width) {
  return std::min(texels, texels / width + count);
}

std::size_t decode_lpca_images(const Device& device, const DecodeLpcaShape& shape) {
  const std::size_t image = shape.panels * panel_width(device) * shape.channels * sizeof(float);
  return std::clamp<std::size_t>(decode_lpca_cached_bytes / image, 1, shape.all_images);
}

std::size_t decode_lpca_bytes(const Device& device, const DecodeLpcaShape& shape) {
  // and the four values that the last texel's load may touch
  return (decode_lpca_images(device, shape) * shape.panels * panel_width(device) * shape.channels +
          4) *
         sizeof(float);
}

void decode_lpca(Device& device, const DecodeLpcaShape& shape, const Buffer& panels,
                 const Buffer& slots, const Buffer& A, const Buffer& B, const Buffer& mean,
                 Buffer& sorted, Buffer& out) {
  const std::string options =
      fmt::format("{} {} -DCHANNELS={}", vector_option(device),
                  device.tuned_options(tunables::decode_lpca), shape.channels);
  const cl_kernel decode = device.kernel(kernel_sources::decode_lpca, options, "decode_lpca");
  const cl_kernel order = device.kernel(kernel_sources::decode_lpca, options, "order_texels");
  const std::size_t block_panels = device.parameter(tunables::decode_lpca, "PANELS");
  const std::size_t block_images = device.parameter(tunables::decode_lpca, "IMAGES");
  const std::size_t block_texels = device.parameter(tunables::decode_lpca, "TEXELS");
  const std::size_t run = decode_lpca_images(device, shape);
  for (std::size_t done = 0; done < shape.images; done += run) {
    const std::size_t images = std::min(run, shape.images - done);
    set_arguments(decode, ulong(shape.panels), ulong(shape.all_images),
                  ulong(shape.first_image + done), ulong(images), ulong(shape.rank), panels, A, B,
                  mean, sorted);
    launch_items(device, decode, ceil_div(shape.panels, block_panels),
                 ceil_div(images, block_images));
    set_arguments(order, ulong(shape.texels), ulong(shape.panels), ulong(done), slots, sorted, out);
    launch_items(device, order, ceil_div(shape.texels, block_texels), images);
  }
}

}  // namespace weft::ops
