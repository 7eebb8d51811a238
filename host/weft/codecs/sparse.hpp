// The codec `sparse`: see lib/weft/model/sparse.hpp for the model and fit_sparse.hpp for the
// encoder.
#pragma once

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& sparse_codec();

}  // namespace weft
