// Look-ups in runs of raw images, and their mip levels: kernels/look_up_raw.cl, reduce_mip.cl.
#pragma once

#include <cstddef>

#include "weft/btf/btf.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// Adds what images [first, first + images) of the BTF give to batch.out, which is zero before the
// first run; runs come in ascending order. `raw` holds these images in `dtype`.
void look_up_raw(Device& device, const LookupBatch& batch, DType dtype, std::size_t first,
                 std::size_t images, const Buffer& raw);

// The next mip level of images [first_in, first_in + images) of `in`, whose size and representation
// `info` tells, as images from `first_out` on of `out`.
void reduce_mip(Device& device, const BtfInfo& info, std::size_t images, std::size_t first_in,
                const Buffer& in, std::size_t first_out, Buffer& out);

}  // namespace weft::ops
