// The codec `vq`: see lib/weft/model/vq.hpp for the model and lib/weft/reference/vq.hpp for the
// encoder.
#pragma once

#include <string>

#include "weft/codecs/codec.hpp"
#include "weft/reference/vq.hpp"

namespace weft {

const Codec& vq_codec();

// What parameters ask for. Throws input errors for those that make no sense.
VqRequest vq_request(const Parameters& parameters, const BtfInfo& source);

// What a model says of its making.
std::string vq_parameters_json(const VqModel& model, const VqRequest& request,
                               const VqThresholds& thresholds);

}  // namespace weft
