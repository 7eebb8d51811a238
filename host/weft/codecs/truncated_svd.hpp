// Truncated SVD of a BTF's texel x (view, light, channel) unfolding with its mean removed,
// streamed: the data is never whole in memory.
//
//   A[p, r] = T[r, p] - mean[r],   r = (v, l, c),   A ~ A_k = U_k (U_k^T A)
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/codecs/svd_options.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"

namespace weft {

struct TruncatedSvd {
  std::size_t rank = 0;      // k: what was asked, less what the data does not hold
  std::vector<float> mean;   // [n], n = N C
  std::vector<float> left;   // U [P, k], orthonormal columns
  std::vector<float> right;  // A^T U [n, k]: the singular values are in it, descending
  double squares = 0;        // |T|^2, with the mean
  double residual = 0;       // |A - A_k|
  std::size_t passes = 0;    // over the data, without scanning and measuring
  SvdMethod method = SvdMethod::automatic;  // which ran
  std::string reason;                       // and why
};

// What truncated_svd will take. With a goal, what job.held leaves of job.memory bounds the rank;
// without, the job makes no difference.
MemoryPlan plan_truncated_svd(Device& device, TileSource& source, const SvdOptions& options,
                              const Job& job = {});

// Throws input errors for options that do not fit the shape or the device, and an unmet goal where
// what was asked cannot be reached.
TruncatedSvd truncated_svd(Device& device, TileSource& source, const SvdOptions& options, Job& job);

}  // namespace weft
