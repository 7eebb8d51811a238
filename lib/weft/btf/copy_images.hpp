// All images of a source into a sink.
#pragma once

#include <cstddef>
#include <functional>

#include "weft/btf/tile.hpp"

namespace weft {

// Copies every image in the sink's type and encoding, and finishes the sink. Values beyond what the
// sink's type holds are clamped: to [0, 1] for U8, to +-65504 for F16 of F32 values. Holds at most
// about 64 MiB, and at least one image, in each representation; `progress` is called with the
// images done so far. Throws an input error where the shapes differ, what source and sink throw,
// and `interrupted` if a stop was asked for.
void copy_images(TileSource& source, TileSink& sink,
                 const std::function<void(std::size_t done)>& progress);

// Bytes of a run of images of this representation that copy_images holds.
std::size_t copy_images_bytes(const BtfInfo& info);

// Throws an input error unless the two shapes are equal.
void check_same_shape(const BtfShape& from, const BtfShape& to);

}  // namespace weft
