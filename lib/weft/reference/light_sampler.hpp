// Directions to light drawn in double, from slices that are looked up and inverted.
#pragma once

#include <memory>

#include "weft/btf/btf.hpp"
#include "weft/btf/lookup.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft::reference {

// Of a material that `info` describes and `sampler` looks up in: for each slice the values under
// every measured light. Throws an input error for a `paired` layout; its functions throw those of
// validate_light_queries().
std::unique_ptr<LightSampler> slice_light_sampler(const BtfInfo& info,
                                                  std::unique_ptr<ReferenceSampler> sampler);

}  // namespace weft::reference
