// Sparse tensor decomposition (Ruiters & Klein 2009) in double.
#pragma once

#include <cstddef>
#include <span>

#include "weft/model/sparse.hpp"

namespace weft::reference {

// Images [first, first + count) of a model, [count][Y][X][C].
void decode_sparse(const SparseModel& model, std::size_t first, std::size_t count,
                   std::span<double> out);

}  // namespace weft::reference
