// Look-ups of single texels in clustered tensor models on a device.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/kcta.hpp"

namespace weft {

// Of clusters of views: the factors of texels are multiplied into the cores, and a look-up takes
// the rows of its views' clusters alone. Of other clusters: those of the stacked model.
std::unique_ptr<DeviceSampler> kcta_sampler(Device& device, const KctaModel& model);
std::size_t kcta_sampler_bytes(const KctaModel& model);

}  // namespace weft
