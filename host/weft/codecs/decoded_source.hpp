// A model as a source of images: decoded when they are read, F32 in the model's encoding.
#pragma once

#include <memory>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/codecs/codec.hpp"

namespace weft {

// By the device, which must outlive it, or by the reference if `device` is null. Keeps the model.
std::shared_ptr<TileSource> decoded_source(Device* device, std::shared_ptr<const Model> model);

}  // namespace weft
