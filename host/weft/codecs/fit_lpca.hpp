// The encoder of `lpca`: alternates between fitting local subspaces and assigning texels to the
// nearest one, first in the space of a global truncated SVD, where the whole BTF is a small matrix
// that stays on the device, then on the data itself, which streams by twice per iteration.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/model/lpca.hpp"

namespace weft {

struct LpcaOptions {
  std::size_t clusters = 32;
  std::size_t rank = 8;
  std::size_t iterations = 10;  // at most, on the data
};

struct LpcaFit {
  std::unique_ptr<LpcaModel> model;    // info holds nothing yet
  std::vector<double> errors;          // |T - T'| / |T| of each fit to the data; none is above
                                       // the one before, and below 1e-3 they are 0: unresolved
  std::vector<double> reduced_errors;  // the same of the fits in the reduced space, within it, of
                                       // the best of its starts
  std::size_t reduced_rank = 0;        // of the global SVD
  std::string svd;                     // which ran, and why
};

// What fit_lpca will take: the global SVD, or the clustering after it, whichever is more.
MemoryPlan plan_lpca(Device& device, TileSource& source, const LpcaOptions& options);

// Iterates until the error falls by less than one part in a thousand. `clusters` is cut to the
// number of texels; clusters for which the data has no use are left out.
LpcaFit fit_lpca(Device& device, TileSource& source, const LpcaOptions& options, Job& job);

}  // namespace weft
