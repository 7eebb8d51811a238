// The encoder of `sparse` (Ruiters & Klein 2009, sections 4.1 and 4.2):
//
//   A = U Sigma W^T        truncated SVD of the texels' ABRDFs, their mean removed, streamed
//   U Sigma ~ P D          K-SVD over the texels, in the space of W, k2 terms each
//   B = diag(|P_j|) D W^T  the atoms as ABRDFs, weighted by the norms of their rows of P
//   B ~ V L                K-SVD over the views of all atoms, k1 terms each
//
// and the weights are divided out of V again. Only the first step reads the input. The squared
// error is foreseen as the sum of what the three approximations leave.
#pragma once

#include "weft/btf/tile.hpp"
#include "weft/codecs/sparse_goal.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

MemoryPlan plan_sparse(Device& device, TileSource& source, const SparseOptions& options,
                       const Job& job);

// `device`, `source` and `job` must outlive it.
std::unique_ptr<SparseEncoder> sparse_encoder(Device& device, TileSource& source,
                                              const SparseOptions& options, Job& job);

// The fit that `options` ask for, of a goal as sparse_goal.hpp says. The model is rounded to its
// storage.
SparseFit fit_sparse(Device& device, TileSource& source, const SparseOptions& options, Job& job);

}  // namespace weft
