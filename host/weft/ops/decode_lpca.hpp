// Images from a local PCA model on the device: kernels/decode_lpca.cl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"

namespace weft::ops {

// Texels sorted by cluster, each cluster filling whole panels of `width` slots.
struct ClusterPanels {
  // A slot's texel; padding repeats a texel of its cluster, so that whatever reads it stays in
  // bounds.
  std::vector<std::uint32_t> order;   // [panels][width]
  std::vector<std::uint32_t> panels;  // [panels][2]: cluster, slots that are texels
  std::vector<std::size_t> first;     // [clusters + 1]: first panel of each, and the end
  std::vector<std::uint32_t> slots;   // [P]: the slot of each texel

  std::size_t count() const { return panels.size() / 2; }
};

// clusters[p] is below `count`. Texels ascend within a cluster; an empty cluster has no panel.
ClusterPanels cluster_panels(std::span<const std::uint32_t> clusters, std::size_t count,
                             std::size_t width);

// Panels that any clustering of `texels` into `count` takes at most.
std::size_t most_cluster_panels(std::size_t texels, std::size_t count, std::size_t width);

struct DecodeLpcaShape {
  std::size_t all_images = 0;  // of the model
  std::size_t first_image = 0;
  std::size_t images = 0;
  std::size_t texels = 0;
  std::size_t channels = 0;
  std::size_t rank = 0;
  std::size_t panels = 0;
};

// Images are decoded so many at once that their texels, sorted by cluster, stay in the caches until
// they are put in order; one at least. A function of the shape alone.
inline constexpr std::size_t decode_lpca_cached_bytes = std::size_t{4} << 20;
std::size_t decode_lpca_images(const Device& device, const DecodeLpcaShape& shape);

// Bytes of the buffer for the sorted texels.
std::size_t decode_lpca_bytes(const Device& device, const DecodeLpcaShape& shape);

// out[image, p, c] = mean[g] + sum_j A[p, j] B[g, image, c, j], g the cluster of texel p.
//   panels, slots: those of a ClusterPanels of panel_width(device)
//   A:      [panels][k][NR], zero in padding
//   B:      [clusters][all images C][k]; mean: [clusters][all images C]
//   sorted: decode_lpca_bytes()
//   out:    [images][P][C] floats: images [first_image, first_image + images) of the model
void decode_lpca(Device& device, const DecodeLpcaShape& shape, const Buffer& panels,
                 const Buffer& slots, const Buffer& A, const Buffer& B, const Buffer& mean,
                 Buffer& sorted, Buffer& out);

}  // namespace weft::ops
