// Singular vectors of modes too long for a Gram matrix, by randomised iteration: of all texels, as
// TensorTextures' U_texel (Vasilescu & Terzopoulos 2004, Fig. 5), or of all images.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/tile.hpp"
#include "weft/codecs/held_tensor.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

struct LongModeVectors {
  std::vector<double> squares;  // squared singular values, descending
  std::vector<double> vectors;  // row-major [size][columns], orthonormal columns
  std::size_t columns = 0;      // the rank that was asked, less what the data does not hold
};

// Of group n of a source, times `scale`, streamed. Throws an input error that names the mode unless
// its group holds all modes of its kind, but for modes of one index.
LongModeVectors long_mode_vectors(Device& device, TileSource& source, const ModeGroups& groups,
                                  std::size_t n, std::size_t rank, float scale, Job& job);

// Of a mode of a tensor in host memory.
LongModeVectors long_mode_vectors(Device& device, const HeldTensor& T, std::size_t mode,
                                  std::size_t rank, Job& job);

// Bytes that either takes, of a source of that shape.
std::size_t long_mode_bytes(Device& device, TileSource& source, const ModeGroups& groups,
                            std::size_t n, std::size_t rank);

}  // namespace weft
