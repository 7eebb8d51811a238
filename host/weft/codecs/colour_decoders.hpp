// What stands between a codec's own decoders, which give the values that were fitted, and what
// decoding a model gives: the inverse of its colour transform, and the channels that are kept.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/codecs/codec.hpp"

namespace weft {

// The given decoder or sampler of `model` with the inverse of its colour transform behind it;
// itself where there is none. Samplers interpolate decoded values; where the transform is not
// linear, they look up single taps with the given one, invert these and sum them.
std::unique_ptr<DeviceDecoder> with_inverse(Device& device, const Model& model,
                                            std::unique_ptr<DeviceDecoder> fitted);
std::unique_ptr<DeviceSampler> with_inverse(Device& device, const Model& model,
                                            std::unique_ptr<DeviceSampler> fitted);
std::unique_ptr<ReferenceDecoder> with_inverse(const Model& model,
                                               std::unique_ptr<ReferenceDecoder> fitted);
std::unique_ptr<ReferenceSampler> with_inverse(const Model& model,
                                               std::unique_ptr<ReferenceSampler> fitted);
// Bytes of device memory that the decoder, and the sampler, takes beside the given one.
std::size_t inverse_bytes(const Model& model);
std::size_t sampler_inverse_bytes(const Model& model);

// Some channels of what a decoder or sampler of a BTF of shape `whole` gives. A sampler keeps
// whole.channels floats for each look-up of the largest call.
std::unique_ptr<DeviceDecoder> with_channels(Device& device, const BtfShape& whole,
                                             std::span<const std::size_t> channels,
                                             std::unique_ptr<DeviceDecoder> all);
std::unique_ptr<DeviceSampler> with_channels(Device& device, const BtfShape& whole,
                                             std::span<const std::size_t> channels,
                                             std::unique_ptr<DeviceSampler> all);
std::unique_ptr<ReferenceDecoder> with_channels(const BtfShape& whole,
                                                std::span<const std::size_t> channels,
                                                std::unique_ptr<ReferenceDecoder> all);
std::unique_ptr<ReferenceSampler> with_channels(const BtfShape& whole,
                                                std::span<const std::size_t> channels,
                                                std::unique_ptr<ReferenceSampler> all);
// Bytes of device memory that the decoder takes beside the given one.
std::size_t channel_decoder_bytes(const BtfShape& whole, std::size_t kept);

}  // namespace weft
