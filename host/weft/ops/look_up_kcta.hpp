// Look-ups in clustered tensor models: the second kernel of kernels/look_up_tucker.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

struct KctaRows {
  std::size_t clusters = 1;
  std::size_t mixtures = 1;     // clusters of each view
  std::size_t views = 1;        // rank of each cluster in the views
  std::size_t lights = 1;       // rank of the lights
  bool light_channels = false;  // lights and channels are one mode
  bool local_lights = false;    // lights have a factor for each cluster
};

// clusters: [V][mixtures] uint; U: [V][mixtures][views]; L: [1 or clusters][L][C where merged]
// rows; T: [P][C where not merged][clusters][views] rows; rows of L and T are padded as
// write_rows() does it.
void look_up_kcta(Device& device, const LookupBatch& batch, const KctaRows& rows,
                  const Buffer& clusters, const Buffer& U, const Buffer& L, const Buffer& T);

}  // namespace weft::ops
