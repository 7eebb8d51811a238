// The codec `view-pca`: a truncated SVD of every view by itself. See lib/weft/model/view_pca.hpp
// for the model.
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& view_pca_codec();

}  // namespace weft
