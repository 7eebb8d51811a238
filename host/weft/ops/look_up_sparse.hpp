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

// The dictionary [D1][L][C] as the kernel reads it.
std::vector<float> lookup_dictionary(std::size_t atoms, std::size_t lights, std::size_t channels,
                                     std::span<const float> dictionary);
std::size_t lookup_dictionary_floats(std::size_t atoms, std::size_t lights, std::size_t channels);

// The texels' terms, [P][k2], with the end of each list marked: [P][k2 + 1].
std::vector<std::uint32_t> end_lists(std::span<const std::uint32_t> atoms, std::size_t length);
std::vector<float> end_lists(std::span<const float> coefficients, std::size_t length);

// The views' terms as the kernel reads them, [D2][V] rows of lookup_row(k1) words: the bits of the
// coefficients, then indices of 16 bits. Rows that fit a cache line don't cross one.
std::size_t lookup_row(std::size_t length);
std::vector<std::uint32_t> lookup_rows(std::span<const std::uint32_t> atoms,
                                       std::span<const float> coefficients, std::size_t length);

enum class TexelLists { merged, one_by_one };

struct SparseLengths {
  std::size_t light_atoms = 0;  // D1
  std::size_t view_terms = 0;   // k1
  std::size_t texel_terms = 0;  // k2
};

// V: by lookup_rows(); P: terms by end_lists(); dictionary by
// lookup_dictionary(); mean: [V][L][C]. Merged lists take an
// atom that texels share once, which takes longer than it saves unless they share many.
void look_up_sparse(Device& device, const LookupBatch& batch, const SparseLengths& lengths,
                    const Buffer& V, const SparseTerms& P, const Buffer& dictionary,
                    const Buffer& mean, TexelLists lists = TexelLists::one_by_one);

// Flops of one look-up whose texels have no atom in common.
double look_up_sparse_flops(const LookupShape& lookup, std::size_t channels,
                            const SparseLengths& lengths);

}  // namespace weft::ops
