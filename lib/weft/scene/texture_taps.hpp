// Where a shading point looks into its material: mip levels and texels.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/shading_point.hpp"

namespace weft {

// The texels about a point, of one image of height x width, and their bilinear weights. Texel
// centres lie at (column + 0.5) / width and (row + 0.5) / height; v runs upwards from the last row.
// The material repeats: beyond an edge lies the texel of the opposite one.
struct TexelTaps {
  std::array<std::uint32_t, 4> texel{};  // y width + x
  std::array<float, 4> weight{};
};
TexelTaps texel_taps(std::array<float, 2> uv, std::size_t height, std::size_t width);

// The two mip levels whose texels are as large as the footprint, level and level + 1, and the share
// of the coarser one; 0 where only `level` counts. A footprint's longer axis decides, but no more
// than twice its shorter one: what is seen at a grazing angle stays sharp across.
struct MipTaps {
  std::size_t level = 0;
  float coarser = 0;
};
MipTaps mip_taps(std::array<float, 2> footprint, std::size_t height, std::size_t width);

}  // namespace weft
