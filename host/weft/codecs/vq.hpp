// The codec `vq`: see lib/weft/model/vq.hpp for the model and lib/weft/reference/vq.hpp for the
// encoder.
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& vq_codec();

}  // namespace weft
