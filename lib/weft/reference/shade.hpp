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
// that of its opacities, if it has these. The first `grid.levels` look up in the views of a grid.
// Throws the input errors of validate_material().
struct LevelsOfGrid {
  std::size_t side = 1;
  std::size_t levels = 0;
};
std::unique_ptr<Shader> make_shader(const BtfInfo& info,
                                    std::vector<std::unique_ptr<ReferenceSampler>> levels,
                                    std::vector<std::unique_ptr<ReferenceSampler>> mask_levels,
                                    std::optional<VisibilityMapping> mapping = {},
                                    LevelsOfGrid grid = {});

}  // namespace weft::reference
