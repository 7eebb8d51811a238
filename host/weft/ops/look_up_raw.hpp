// Look-ups in runs of raw images, and their mip levels: kernels/look_up_raw.cl, reduce_mip.cl; and
// look-ups by their single taps.
#pragma once

#include <cstddef>

#include "weft/btf/btf.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// Adds what images [first, first + images) of the BTF give to batch.out, which is zero before the
// first run; runs come in ascending order. `raw` holds these images in `dtype`.
void look_up_raw(Device& device, const LookupBatch& batch, DType dtype, std::size_t first,
                 std::size_t images, const Buffer& raw);

// Taps of one look-up.
constexpr std::size_t taps_of(const LookupShape& lookup) {
  return lookup.views * lookup.lights * lookup.texels;
}

// Records [first, first + count) of `lookups` as records of one tap each, [count][views][lights]
// [texels][words], at the front of `taps`.
void expand_taps(Device& device, const LookupShape& lookup, std::size_t first, std::size_t count,
                 const Buffer& lookups, Buffer& taps);

// The sums of what these taps gave, values [count][views][lights][texels][C], with the weights of
// their records, into out[first ...][C].
void sum_taps(Device& device, const LookupShape& lookup, std::size_t channels, std::size_t first,
              std::size_t count, const Buffer& lookups, const Buffer& values, Buffer& out);

// The next mip level of images [first_in, first_in + images) of `in`, whose size and representation
// `info` tells, as images from `first_out` on of `out`.
void reduce_mip(Device& device, const BtfInfo& info, std::size_t images, std::size_t first_in,
                const Buffer& in, std::size_t first_out, Buffer& out);

}  // namespace weft::ops
