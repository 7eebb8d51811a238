// What the models' `divide` share.
#pragma once

#include "weft/btf/weights.hpp"

namespace weft {

inline void divide_by(float& value, double divisor) {
  value = static_cast<float>(double{value} / divisor);
}

}  // namespace weft
