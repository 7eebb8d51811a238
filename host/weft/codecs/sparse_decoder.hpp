// Decoders of sparse tensor decompositions.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/sparse.hpp"

namespace weft {

// Images in bulk: the ABRDFs of a run of images are combined from the dictionary first, and then
// the texels from them.
std::unique_ptr<DeviceDecoder> sparse_decoder(Device& device, const SparseModel& model);
std::size_t sparse_decoder_bytes(const SparseModel& model);

// Single texels, an atom that several of them use once.
std::unique_ptr<DeviceSampler> sparse_sampler(Device& device, const SparseModel& model);
std::size_t sparse_sampler_bytes(const SparseModel& model);

// The same in double.
std::unique_ptr<ReferenceDecoder> sparse_reference_decoder(const SparseModel& model);

// Bound of |device - reference| for one decoded value.
double sparse_decode_tolerance(const SparseModel& model);

}  // namespace weft
