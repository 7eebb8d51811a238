// The codec `tucker`: N-mode SVD of the whole tensor (TensorTextures, Vasilescu & Terzopoulos
// 2004).
#pragma once

#include <memory>
#include <string_view>

#include "weft/codecs/codec.hpp"

namespace weft {

const Codec& tucker_codec();

// A model for decoding with the factors of some modes, "y,x", multiplied into its core, or itself
// where none are named. Throws an input error that names --expand for models of other codecs and
// for modes that the model has not.
std::unique_ptr<Model> expand_modes(std::unique_ptr<Model> model, std::string_view modes);

}  // namespace weft
