// The codec `lpca`: see lib/weft/model/lpca.hpp for the model and fit_lpca.hpp for the encoder.
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& lpca_codec();

}  // namespace weft
