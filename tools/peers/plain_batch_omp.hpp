// Batch-OMP in plain C++ with OpenMP: what a user would write without a device.
#pragma once

#include <cstddef>
#include <cstdint>

namespace weft::peers {

// Batch-OMP with a progressive Cholesky factorisation (Rubinstein, Zibulevsky, Elad 2008) of
// signals whose correlations with unit atoms are known: alpha0 is [signals][atoms], G is
// [atoms][atoms]. Indices and coefficients are [signals][k].
void plain_batch_omp(std::size_t signals, std::size_t atoms, std::size_t k, const float* alpha0,
                     const float* G, std::uint32_t* indices, float* coefficients);

void plain_set_threads(int threads);

}  // namespace weft::peers
