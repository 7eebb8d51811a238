// A model's real-valued tensors rounded to what its file will give back, so that the model in
// memory is the one that is read again, bit for bit.
#pragma once

#include "weft/model/model.hpp"

namespace weft {

// Rounds each tensor to half or float, as it is to be stored; see component_scale.hpp.
void round_to_storage(Model& model);

}  // namespace weft
