// Decoders of nested code-books.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/vq.hpp"

namespace weft {

// Images in bulk: the apparent BRDFs of a run of images first, then the texels from them.
std::unique_ptr<DeviceDecoder> vq_decoder(Device& device, const VqModel& model);
std::size_t vq_decoder_bytes(const VqModel& model);

// Single texels by chained look-ups.
std::unique_ptr<DeviceSampler> vq_sampler(Device& device, const VqModel& model);
std::size_t vq_sampler_bytes(const VqModel& model);

// Images in double.
std::unique_ptr<ReferenceDecoder> vq_reference_decoder(const VqModel& model);

// Bound of |device - reference| for one decoded value.
double vq_decode_tolerance(const VqModel& model);

}  // namespace weft
