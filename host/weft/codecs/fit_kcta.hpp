// K-clustered tensor approximation on a device (Tsai & Shih 2012, Algorithm 1; equation numbers are
// theirs). The global bases are those of a Tucker decomposition of the stream (fit_tucker.hpp);
// what it leaves, A_G of (23), is held in host memory or a file as slices along the clustered mode:
//
//   A  [slices][row]       the slices
//   B  [C R_m][row]        the clusters' rows Z_c x_n U_n,c, n != m
//
// The clustering stage (mix_slices.hpp) needs of them A B^T and B B^T alone.
#pragma once

#include <memory>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

// The model's info is left to the caller, and so is rounding it. Throws input errors for NaN or
// infinite values and for what does not fit job.memory.
KctaFit fit_kcta(Device& device, TileSource& source, const KctaRequest& request, Job& job);

// The same, to be fitted again.
std::unique_ptr<KctaEncoder> kcta_encoder(Device& device, TileSource& source,
                                          const KctaRequest& request, Job& job);

}  // namespace weft
