// How a Tucker decomposition goes through its data (fit_tucker.hpp), and what memory that will
// take.
#pragma once

#include "weft/btf/tile.hpp"
#include "weft/codecs/fit_tucker.hpp"
#include "weft/codecs/tensor_tiles.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/tucker.hpp"

namespace weft {

// The kind of tiles that a mode is cut in: those that hold it whole.
TensorTiles::By kind_of(const ModeGroup& group);

// The kind that is projected while the data is streamed: the only one that is cut, or the one that
// leaves less; with a goal, and between equals, directions.
TensorTiles::By first_kind(const TuckerRequest& request);

// What the fit will take. With a goal, the ranks are not known: the projected tensor is then
// planned where they are, and fit_tucker() throws if it does not fit.
MemoryPlan plan_tucker(Device& device, TileSource& source, const TuckerOptions& options,
                       const Job& job);

}  // namespace weft
