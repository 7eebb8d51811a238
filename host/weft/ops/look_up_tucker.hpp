// Look-ups in Tucker models: kernels/look_up_tucker.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

struct TuckerRows {
  std::size_t views = 1;        // rank of the views; 1 where they are one mode with the lights
  std::size_t lights = 1;       // rank of the lights
  bool views_merged = false;    // views and lights are one mode
  bool light_channels = false;  // so are lights and channels
};

// V: [V] rows, or one of 1; L: [L or V L][C where merged] rows; T: [P][C where not merged][views]
// rows; all padded as write_rows() does it.
void look_up_tucker(Device& device, const LookupBatch& batch, const TuckerRows& rows,
                    const Buffer& V, const Buffer& L, const Buffer& T);

}  // namespace weft::ops
