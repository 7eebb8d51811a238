// Look-ups by their definition, in double.
#pragma once

#include <memory>

#include "weft/btf/lookup.hpp"
#include "weft/btf/tile.hpp"
#include "weft/model/model.hpp"

namespace weft::reference {

// Tap by tap with Model::fitted_texel: what comes out is in the terms of what was fitted, before
// the model's colour transform is inverted. The model must outlive it.
std::unique_ptr<ReferenceSampler> texel_sampler(const Model& model);

// Of the values of raw images, as read_tile reads them. Goes through the source once for each call,
// and holds one image. The source must outlive it.
std::unique_ptr<ReferenceSampler> tile_sampler(TileSource& source);

}  // namespace weft::reference
