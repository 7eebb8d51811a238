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
#include "weft/codecs/fit_goal.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/sparse.hpp"

namespace weft {

// With a goal, the lengths of lists are the most, and with a relative error so is the rank.
struct SparseOptions : SparseRequest {
  // With a size as the goal: the rank is doubled up to this, and as far as memory goes, while the
  // projection alone makes more than half of the squared error. 0: the rank stays.
  std::size_t most_rank = 0;
  Storage storage = Storage::f16;
  FitGoal goal;
};

MemoryPlan plan_sparse(Device& device, TileSource& source, const SparseOptions& options,
                       const Job& job);

// With a goal: one decomposition with long lists, from which k1 and k2 are chosen, and another with
// these from the dictionaries that came out. A relative error is measured of the stored model, and
// longer lists are taken until it is met. Throws the unmet goal with what was reached. The model is
// rounded to its storage.
SparseFit fit_sparse(Device& device, TileSource& source, const SparseOptions& options, Job& job);

}  // namespace weft
