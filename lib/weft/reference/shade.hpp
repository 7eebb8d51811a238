// Shading in double, point by point: the truth that the device is checked against.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "weft/btf/lookup.hpp"
#include "weft/scene/shader.hpp"

namespace weft::reference {

// Of a material described by `info`. `levels` look up its mip levels, mip_levels(info.shape) of
// them; `mask_levels` those of its mask_sources(), and are empty where it has no mask; `mapping` is
// that of its opacities, if it has these. Throws the input errors of validate_material().
//
// The first `own.count` levels are models': they look up in the views of a grid if it has a side,
// or by directions themselves.
struct OwnLevels {
  std::size_t count = 0;
  std::size_t grid_side = 0;
  bool directions = false;
};
std::unique_ptr<Shader> make_shader(const BtfInfo& info,
                                    std::vector<std::unique_ptr<ReferenceSampler>> levels,
                                    std::vector<std::unique_ptr<ReferenceSampler>> mask_levels,
                                    std::optional<VisibilityMapping> mapping = {},
                                    OwnLevels own = {});

}  // namespace weft::reference
