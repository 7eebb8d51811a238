#include "weft/ops/decode_lpca.hpp"

#include <fmt/core.h>

#include <algorithm>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t block_panels = 4;
constexpr std::size_t block_images = 16;
}  // namespace

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

void decode_lpca(Device& device, const DecodeLpcaShape& shape, const Buffer& order,
                 const Buffer& panels, const Buffer& A, const Buffer& B, const Buffer& mean,
                 Buffer& out) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::decode_lpca,
                    fmt::format("{} -DCHANNELS={} -DPANELS={} -DIMAGES={}", vector_option(device),
                                shape.channels, block_panels, block_images),
                    "decode_lpca");
  set_arguments(kernel, ulong(shape.texels), ulong(shape.panels), ulong(shape.all_images),
                ulong(shape.first_image), ulong(shape.images), ulong(shape.rank), order, panels, A,
                B, mean, out);
  launch_items(device, kernel, ceil_div(shape.panels, block_panels),
               ceil_div(shape.images, block_images));
}

}  // namespace weft::ops
