// Tucker decompositions on a device, streamed: the data is never whole in memory.
//
// Modes of directions are cut where tiles hold all images of some texels, modes of texels where
// they hold all texels of some images (tensor_tiles.hpp). The first kind is projected on the way
// and leaves a smaller tensor W in host memory, in which the other kind is cut:
//
//   D, streamed  ->  W = D x_n U_n^T over the modes n of one kind, held  ->  Z, in place
//
// Modes longer than 4096 have no Gram matrix: their singular vectors are those of a streamed or
// held matrix (streamed_svd.hpp), by randomised iteration.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/reference/tucker.hpp"

namespace weft {

struct TuckerOptions {
  TuckerRequest request;
  Arithmetic gram = Arithmetic::f32;  // of Gram matrices: the smallest singular values need f64
};

// The model's info is left to the caller, and so is rounding it. Throws input errors for NaN or
// infinite values and for what does not fit job.memory.
TuckerFit fit_tucker(Device& device, TileSource& source, const TuckerOptions& options, Job& job);

// The squared singular values of modes of the data as it is, times a power of two that they share;
// descending, and none for other modes. Modes are no longer than longest_gram_mode.
std::vector<std::vector<double>> mode_spectra(Device& device, TileSource& source,
                                              const ModeGroups& groups,
                                              std::span<const std::size_t> modes, Job& job);

}  // namespace weft
