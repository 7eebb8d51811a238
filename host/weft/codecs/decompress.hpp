// Bulk decompression: a model's images into a sink.
#pragma once

#include <memory>

#include "weft/codecs/codec.hpp"

namespace weft {

// Decodes all images of the model on the device, run by run, in the sink's type and encoding; while
// the device decodes a run, the run before it is written. Values beyond what the sink's type holds
// are clamped: to [0, 1] for U8, to +-65504 for F16. The sink is finished. Throws input errors
// where the shapes differ or the plan exceeds job.memory.
void decompress(Device& device, const Model& model, TileSink& sink, Job& job);

}  // namespace weft
