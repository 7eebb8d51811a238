// The codec `view-pca` in Eigen, in double: a PCA of every view by itself.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/view_pca.hpp"

namespace weft::reference {

// Up to `rank` components per view; info holds nothing yet. Throws input errors as the device
// encoder does.
std::unique_ptr<ViewPcaModel> encode_view_pca(TileSource& source, std::size_t rank, Job& job);

// Images [first, first + count) as [count][P][C].
void decode_view_pca(const ViewPcaModel& model, std::size_t first, std::size_t count,
                     std::span<double> out);

}  // namespace weft::reference
