// The makers by their names.
#pragma once

#include <array>
#include <string_view>

#include "weft/scene/material.hpp"

namespace weft {

struct MaterialKind {
  std::string_view name;
  MaterialGeometry standard;
};

// One line for each maker, in the order of the variant.
inline std::array<MaterialKind, std::variant_size_v<MaterialGeometry>> kinds_of_material() {
  return {{{"weave", WeaveCloth{}},
           {"knit", Knit{}},
           {"corduroy", Corduroy{}},
           {"leather", Leather{}},
           {"hammered_metal", HammeredMetal{}},
           {"gravel", Gravel{}},
           {"coins", Coins{}},
           {"net", Net{}}}};
}

}  // namespace weft
