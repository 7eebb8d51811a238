// Look-ups by their definition, in double.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/lookup.hpp"
#include "weft/btf/tile.hpp"
#include "weft/model/model.hpp"

namespace weft::reference {

// Tap by tap with Model::fitted_texel and fitted_texel_at: what comes out is in the terms of what
// was fitted, before the model's colour transform is inverted. The model must outlive it.
std::unique_ptr<ReferenceSampler> texel_sampler(const Model& model);

// Of the values of raw images, as read_tile reads them. Goes through the source once for each call,
// and holds one image. The source must outlive it.
std::unique_ptr<ReferenceSampler> tile_sampler(TileSource& source);

// The taps of each record as records of one tap, [count][views][lights][texels][words].
std::vector<std::uint32_t> expand_taps(const LookupShape& lookup,
                                       std::span<const std::uint32_t> lookups);

// out[i, c] = sum_{a,b,t} u_t v_a w_b values[i, a, b, t, c]: the sums of what these taps gave.
void sum_taps(const LookupShape& lookup, std::span<const std::uint32_t> lookups,
              std::size_t channels, std::span<const double> values, std::span<double> out);

}  // namespace weft::reference
