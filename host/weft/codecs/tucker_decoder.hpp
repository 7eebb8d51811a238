// Decoding of Tucker models in bulk on a device.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// Images in bulk: d = T x l x v (Vasilescu & Terzopoulos 2004, eq. (8)). The core is multiplied by
// the rows of some views at once, which all their lights share. What is left is multiplied by the
// factors of texels and channels, and then by rows of lights, which are images; or by the rows of
// lights first, where that is less work.
std::unique_ptr<DeviceDecoder> tucker_decoder(Device& device, const TuckerModel& model);
// Bytes that it holds on the device, and here while it is made.
std::size_t tucker_decoder_bytes(const TuckerModel& model);

}  // namespace weft
