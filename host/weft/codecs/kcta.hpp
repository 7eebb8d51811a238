// The codecs `kcta` and `cta`: clustered tensor approximation, with several mixture clusters for
// each slice or with one (Tsai & Shih 2012).
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& kcta_codec();
const Codec& cta_codec();

}  // namespace weft
