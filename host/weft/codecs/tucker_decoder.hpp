// Decoders of Tucker models on a device.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// Images in bulk: d = T x l x v (Vasilescu & Terzopoulos 2004, eq. (8)). The core is multiplied by
// the rows of some views once, which all their lights share; then by rows of lights, and what is
// left by the factors of texels and channels.
std::unique_ptr<DeviceDecoder> tucker_decoder(Device& device, const TuckerModel& model);
std::size_t tucker_decoder_bytes(const TuckerModel& model);

// Single texels, eq. (9): the factors of texels are multiplied into the core, so that a look-up is
// a product of the ranks of directions only.
std::unique_ptr<DeviceSampler> tucker_sampler(Device& device, const TuckerModel& model);
std::size_t tucker_sampler_bytes(const TuckerModel& model);

}  // namespace weft
