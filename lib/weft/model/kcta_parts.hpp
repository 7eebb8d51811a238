// Models made of a clustered tensor model: factors multiplied out.
#pragma once

#include <memory>
#include <string_view>

#include "weft/model/kcta.hpp"

namespace weft {

// The factors of some modes, "y,x", multiplied into the cores: memory for speed, as the paper does
// before it renders (Tsai & Shih 2012, section 6.3.3). Throws an input error that names --expand
// and lists the modes for others, and for the mode of the clusters; modes without a factor are
// expanded as they are.
std::unique_ptr<KctaModel> expanded(const KctaModel& model, std::string_view modes);

}  // namespace weft
