// Truncated SVD of a BTF's texel x (view, light, channel) unfolding with its mean removed,
// streamed: the data is never whole in memory.
//
//   A[p, r] = T[r, p] - mean[r],   r = (v, l, c),   A ~ U_k (U_k^T A)
//
// Block Krylov iteration (Musco & Musco 2015) on A A^T from a random block, with full
// re-orthogonalisation and Rayleigh-Ritz over the whole basis. One pass over the data, image run by
// image run, gives both products of a step:
//
//   W_t = A^T Q_t        Y_t = A W_t        Q_{t+1} = orth((I - K K^T) Y_t),  K = [Q_0 .. Q_t]
//
// and, from the eigenvalues of W^T W, W = [W_0 .. W_t], the error of the best rank-k approximation
// in the basis: |A|^2 - sum of the k largest.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/job.hpp"

namespace weft {

struct StreamedSvd {
  std::size_t rank = 0;      // k: what was asked, less what the data does not hold
  std::vector<float> mean;   // [n], n = N C
  std::vector<float> left;   // U [P, k], orthonormal columns
  std::vector<float> right;  // A^T U [n, k]: the singular values are in it, descending
  std::size_t passes = 0;    // over the data, without scanning and measuring
  double error = 0;          // |A - A_k| / |T|, as far as float norms tell
};

// What streamed_svd will take, for a plan.
MemoryPlan plan_streamed_svd(Device& device, TileSource& source, std::size_t rank);

// Iterates until the error is foreseen to be within 1 % of the best rank-k error; where it is too
// small beside |A| to be known from norms, it is measured, and iterated until it no longer falls.
// `rank` is at least 1 and is cut to min(P, n).
StreamedSvd streamed_svd(Device& device, TileSource& source, std::size_t rank, Job& job);

}  // namespace weft
