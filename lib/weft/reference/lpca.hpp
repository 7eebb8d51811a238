// The codec `lpca` in Eigen, in double: the truth that the device is checked against.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/lpca.hpp"

namespace weft::reference {

struct LpcaOptions {
  std::size_t clusters = 32;
  std::size_t rank = 8;
  std::size_t iterations = 20;  // at most
};

struct LpcaFit {
  std::unique_ptr<LpcaModel> model;  // info holds nothing yet
  std::vector<double> errors;        // |T - T'| / |T| of each iteration's bases
};

// Alternates between the PCA of each cluster and the assignment of each texel to the cluster that
// reconstructs it best, from a k-means clustering, until the error falls by less than one part in a
// thousand; holds the whole BTF in memory, in double. Throws input errors as the device encoder
// does.
LpcaFit encode_lpca(TileSource& source, const LpcaOptions& options, Job& job);

// Images [first, first + count) as [count][P][C].
void decode_lpca(const LpcaModel& model, std::size_t first, std::size_t count,
                 std::span<double> out);

}  // namespace weft::reference
