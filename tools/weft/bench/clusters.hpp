// Clusters that benchmarks share.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/decode_lpca.hpp"

namespace weft {

// Clusters in runs of 64 texels.
ops::ClusterPanels bench_clusters(const Device& device, std::size_t texel_count,
                                  std::size_t cluster_count);

}  // namespace weft
