// Errors of a model on a logarithmic scale, for data whose plain errors are those of its
// highlights.
#pragma once

#include "weft/codecs/codec.hpp"
#include "weft/metrics/log_errors.hpp"

namespace weft {

// Decodes all images on the device, or by the reference if it is null, and compares them with
// `raw`, of the same shape, in one streaming pass; the sums become those of the request's scale.
void measure_log_errors(Device* device, const Model& model, TileSource& raw, LogErrorRequest& log,
                        Job& job);

}  // namespace weft
