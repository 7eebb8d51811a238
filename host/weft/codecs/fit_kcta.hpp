// K-clustered tensor approximation on a device (Tsai & Shih 2012, Algorithm 1; equation numbers are
// theirs). The global bases are those of a Tucker decomposition of the stream (fit_tucker.hpp);
// what it leaves, A_G of (23), is held in host memory or a file as slices along the clustered mode:
//
//   A  [slices][row]       the slices
//   B  [C R_m][row]        the clusters' rows Z_c x_n U_n,c, n != m
//
// The clustering stage needs of them A B^T and B B^T alone. With a = A_i B_c^T and
// G_jc = B_j B_c^T the terms of the greedy search (9), (13) are, by (7), (14) and (19),
//
//   ufm(A^(c)) V_c^T  = a (B_c B_c^T)^-1/2        ufm(Z_j^(c) x_m u) V_c^T = u G_jc (B_c
//   B_c^T)^-1/2
//
// and those of optimal projection (17), (18) are the blocks of G and a themselves: R_m rows for
// each cluster take the place of its R_1 R_2 ... R_N-dimensional space.
#pragma once

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

// The model's info is left to the caller, and so is rounding it. Throws input errors for NaN or
// infinite values and for what does not fit job.memory.
KctaFit fit_kcta(Device& device, TileSource& source, const KctaRequest& request, Job& job);

// What the fit will take.
MemoryPlan plan_kcta(Device& device, TileSource& source, const KctaRequest& request,
                     const Job& job);

// The clustering stage from A B^T [slices][C R], B B^T [C R][C R] and the squared norms of slices.
reference::KctaMixing mix_by_products(std::size_t clusters, std::size_t mixtures,
                                      std::span<const double> products,
                                      std::span<const double> gram,
                                      std::span<const double> squares);

}  // namespace weft
