// Decoding of clustered tensor models in bulk on a device.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/kcta.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

// A clustered model as one Tucker model: with the factors of each cluster multiplied out, their
// cores are one, [C R_m] in mode m, and the mixing matrices beside each other are its factor. Where
// that is no shorter than the mode itself, they are multiplied out too.
std::unique_ptr<TuckerModel> stacked(Device& device, const KctaModel& model);
// The same without the core; and the bytes that its core takes on the host, and while it is made.
std::unique_ptr<TuckerModel> stacked_outline(const KctaModel& model);
std::size_t stacking_bytes(const KctaModel& model);

std::unique_ptr<DeviceDecoder> kcta_decoder(Device& device, const KctaModel& model);

// Bytes that it holds on the device, and here while it is made.
std::size_t kcta_decoder_bytes(const KctaModel& model);

}  // namespace weft
