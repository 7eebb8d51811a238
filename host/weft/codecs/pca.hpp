// The codec `pca`: see lib/weft/model/pca.hpp for the model and streamed_svd.hpp for the encoder.
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& pca_codec();

}  // namespace weft
