// The codec `tt`: see lib/weft/model/tt.hpp for the model, fit_tt.hpp for the encoder and
// tt_goal.hpp for how goals are met.
#pragma once

#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/tt.hpp"

namespace weft {

const Codec& tt_codec();

// TT-rounding: a train cut further, without decoding it, to ranks or a goal as of the codec's
// parameters; errors are against the model. The order of modes stays.
std::unique_ptr<Model> round_tt(const TtModel& model, const Parameters& parameters, Storage storage,
                                Job& job);

// The trains that one can be cut to, for goals beside those.
std::unique_ptr<NestedModels> nested_train(const TtModel& model, const Parameters& parameters,
                                           Storage storage, Job& job);

}  // namespace weft
