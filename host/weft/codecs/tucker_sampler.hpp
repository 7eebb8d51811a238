// Look-ups of single texels in Tucker models on a device.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// Vasilescu & Terzopoulos 2004, eq. (9): the factors of texels are multiplied into the core, so
// that a look-up is a product of the ranks of directions only.
std::unique_ptr<DeviceSampler> tucker_sampler(Device& device, const TuckerModel& model);
std::size_t tucker_sampler_bytes(const TuckerModel& model);

}  // namespace weft
