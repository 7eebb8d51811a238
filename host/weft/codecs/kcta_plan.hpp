// What memory a fit of clustered tensors takes (fit_kcta.hpp).
#pragma once

#include <cstddef>

#include "weft/btf/tile.hpp"
#include "weft/codecs/decompose_cluster.hpp"
#include "weft/codecs/fit_tucker.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

// The decomposition of the global bases: those modes are cut, the others stay whole.
TuckerOptions global_bases_kcta(const KctaRequest& request);

// Bytes that are held beside A: rows of clusters, and of slices less what clusters make of them.
std::size_t held_beside_kcta(const KctaRequest& request, const SliceShape& shape);

// What is held beside these.
MemoryPlan working_plan_kcta(const Device& device, const KctaRequest& request,
                             const SliceShape& shape);

// What the fit will take.
MemoryPlan plan_kcta(Device& device, TileSource& source, const KctaRequest& request,
                     const Job& job);

}  // namespace weft
