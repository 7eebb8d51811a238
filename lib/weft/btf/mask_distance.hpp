// The visibility of a material with holes as K-CTA (section 6.3.1) compresses it: beside the binary
// mask of a view its signed distance to the outline of the material, whose sharp edges survive
// compression and filtering. Positive where the view meets material, so that eq. (26) draws it:
//
//   alpha = 1 where d >= T,  W d where T > d > 0,  0 elsewhere
//
// The material repeats: distances go round the borders of the tile.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"

namespace weft {

// For every texel of a binary mask [height][width] the distance, in texels, of its centre to the
// nearest centre of a texel of the other kind, less one half: the outline runs between them.
// Positive where the mask is 1. Exact (Euclidean); plus or minus infinity where the mask knows one
// kind only.
std::vector<float> signed_distances(std::span<const std::uint8_t> mask, std::size_t height,
                                    std::size_t width);

// What a view shows of the material, per texel.
struct ViewMask {
  std::vector<std::uint8_t> mask;  // [height][width], 1 where at least half of the texel is covered
  // [height][width], in texels: the mean over the texel's parts, and at least half a part on the
  // side that the mask says. Infinite as in signed_distances.
  std::vector<float> distance;
};

// Of a mask that is `factor` times finer in both directions, [factor height][factor width].
ViewMask view_mask(std::span<const std::uint8_t> fine, std::size_t height, std::size_t width,
                   std::size_t factor);

// Appends the mask and the distances of the next view to those of `info`.
void add_view_mask(std::span<const std::uint8_t> fine, std::size_t factor, BtfInfo& info);

// Divides distances by their largest finite magnitude, for all views at once, and puts infinite
// ones at +1 and -1: everything then lies in [-1, 1] on one scale.
void normalize_distances(std::span<float> distances);

}  // namespace weft
