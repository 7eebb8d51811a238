// The codec `pca` in Eigen, in double: the truth that the device is checked against.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/pca.hpp"

namespace weft::reference {

// Block Krylov iteration as host/weft/codecs/streamed_svd.hpp describes it, with Householder QR and
// an SVD of the products; streams the source image run by image run. The tensors of the result are
// float; info holds nothing yet. Throws input errors as the device encoder does.
std::unique_ptr<PcaModel> encode_pca(TileSource& source, std::size_t rank, Job& job);

// Images [first, first + count) as [count][P][C].
void decode_pca(const PcaModel& model, std::size_t first, std::size_t count, std::span<double> out);

}  // namespace weft::reference
