// Texture synthesis by patches: a texture of any size made of pieces of a small one (Efros and
// Freeman, "Image Quilting for Texture Synthesis and Transfer", SIGGRAPH 2001). What is synthesised
// is where each texel comes from, so that anything that lies on the texels can follow.
//
// Square patches are laid row by row, each over the edges of those before. Of some random pieces of
// the source one is taken at random among those whose overlap differs little more than the least,
// and the border runs through the overlap where the difference is least.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace weft::reference {

struct PatchRequest {
  std::size_t height = 0;
  std::size_t width = 0;
  std::size_t patch = 32;     // side, at most that of the source
  std::size_t overlap = 8;    // below the patch's half
  std::size_t pieces = 1000;  // that are compared for each patch
  double tolerance = 0.1;     // of the least difference
  std::uint64_t seed = 0;
};

// The side of a patch and the overlap for a source of that size: a fourth of its shorter side from
// 4 to 32 texels, and a fourth of that.
PatchRequest patch_request(std::size_t source_height, std::size_t source_width);

// [height][width]: the source's texel y X + x that stands there. `features`
// [source_height][source_width][F] is what is compared. Throws an input error for sizes of 0, for a
// patch larger than the source or an overlap of half of it.
std::vector<std::size_t> synthesise_patches(std::size_t source_height, std::size_t source_width,
                                            std::span<const float> features,
                                            const PatchRequest& request);

}  // namespace weft::reference
