// Look-ups in sparse tensor decompositions: kernels/look_up_sparse.cl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/decode_sparse.hpp"
#include "weft/ops/look_up_factors.hpp"

namespace weft::ops {

// Floats of a row of channels: whole vectors of 4.
std::size_t sparse_channel_floats(std::size_t channels);

// Rows of channels padded so: of the dictionary, [D1 L], and of the mean, [V L].
std::vector<float> pad_channels(std::span<const float> values, std::size_t channels);

// The texels' atoms, [P][k2], with the end of each list marked: [P][k2 + 1].
std::vector<std::uint32_t> end_lists(std::span<const std::uint32_t> atoms, std::size_t length);

enum class TexelLists { merged, one_by_one };

struct SparseLengths {
  std::size_t view_terms = 0;   // k1
  std::size_t texel_terms = 0;  // k2
};

// V: terms [D2][V][k1]; P: terms [P][k2], the atoms by end_lists(); dictionary and mean by
// pad_channels(). Merged lists interpolate an atom that texels share once.
void look_up_sparse(Device& device, const LookupBatch& batch, const SparseLengths& lengths,
                    const SparseTerms& V, const SparseTerms& P, const Buffer& dictionary,
                    const Buffer& mean, TexelLists lists = TexelLists::merged);

// Flops of one look-up whose texels have no atom in common.
double look_up_sparse_flops(const LookupShape& lookup, std::size_t channels,
                            const SparseLengths& lengths);

}  // namespace weft::ops
