// How a Tucker decomposition goes through its data (fit_tucker.hpp), and what memory that will
// take.
#pragma once

#include "weft/btf/tile.hpp"
#include "weft/codecs/fit_tucker.hpp"
#include "weft/codecs/tensor_tiles.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/tucker.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {

// The kind of tiles that a mode is cut in: those that hold it whole.
TensorTiles::By kind_of(const ModeGroup& group);

// The kind that is projected while the data is streamed: the only one that is cut, or the one that
// leaves less; with a goal, and between equals, directions.
TensorTiles::By first_kind(const TuckerRequest& request);

// What the fit will take. The projected tensor is counted where its size is known, without a goal,
// and where it is held in memory; else it goes to a file.
MemoryPlan plan_tucker(Device& device, TileSource& source, const TuckerOptions& options,
                       const Job& job);

// Where a projected tensor of so many bytes is held, beside what else the fit takes.
FloatStore::Place place_of_held(Device& device, TileSource& source, const TuckerOptions& options,
                                const Job& job, std::size_t bytes);

}  // namespace weft
