// Truncated SVD of a streamed matrix X (K x m), in three ways:
//
//   X ~ (X V_k) V_k^T,   V_k (m x k) orthonormal,   X V_k with orthogonal columns of length sigma_j
//
//   gram        X^T X = V diag(sigma^2) V^T in one pass, a second pass for X V. Squares the
//               condition: directions below about sqrt(eps) of the largest are lost.
//   qr          X = Q R by TSQR in one pass, R = U diag(sigma) V^T, a second pass for X V. Accurate
//               to eps of the largest.
//   randomized  block Krylov iteration on X^T X (Musco & Musco 2015), a few passes; see
//               krylov_basis.hpp.
//
// gram and qr leave an m x m problem to the host, and so take m up to `most_dense_columns`.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "weft/codecs/panel_stream.hpp"
#include "weft/codecs/svd_options.hpp"
#include "weft/job.hpp"
#include "weft/ops/tsqr.hpp"

namespace weft {

inline constexpr std::size_t most_dense_columns = 4096;

// What is wanted of a factorisation. Squares and lengths are those of the scaled stream.
struct SvdTarget {
  SvdMethod method = SvdMethod::randomized;  // automatic is not for streams
  std::size_t rank = 0;                      // most components; 0: as many as the goals ask for
  double tolerance = 0;                      // see SvdOptions
  double energy = 0;
  double constant_squares = 0;  // |T|^2 - |X|^2: the tolerance is relative to |T|
  double noise = 0;             // what is shorter is rounding of the input
  // Columns of a basis that memory allows.
  std::size_t most_columns = std::numeric_limits<std::size_t>::max();
  // lean: qr takes no more than gram would
  ops::Tsqr::Workspace workspace = ops::Tsqr::Workspace::ample;

  bool has_goal() const { return tolerance > 0 || energy > 0; }
};

struct StreamedSvd {
  std::size_t rank = 0;        // k
  std::vector<double> values;  // sigma, descending, of the scaled stream
  Buffer V;                    // [m][leading]
  Buffer XV;                   // [K][leading]
  std::size_t leading = 0;     // at least k
  double squares = 0;          // |X|^2
  double residual = 0;         // |X - X V V^T|: measured, or from norms where they resolve it
  std::size_t passes = 0;      // over the data, without measuring
};

// Iterates or projects until the goals are met by the residual; the smallest rank that meets them
// is kept. Without goals the rank that was asked is kept, less directions that are rounding noise
// of the arithmetic; `randomized` then iterates until the error is foreseen to be within 1 % of the
// best. Throws unmet_goal, saying what was reached, where rank, memory or arithmetic do not reach
// the goals.
StreamedSvd streamed_svd(Device& device, PanelStream& stream, const SvdTarget& target, Job& job);

// What it will take, beside what the stream holds, for X of the given size.
struct StreamShape {
  std::size_t rows = 0;
  std::size_t columns = 0;
  std::size_t granule = 0;
  Arithmetic arithmetic = Arithmetic::f32;
};
MemoryPlan plan_streamed_svd(const Device& device, const StreamShape& shape,
                             const SvdTarget& target);

// The most columns of a basis that `memory` bytes hold, where the caller keeps `beside` bytes for
// each; 1 where there is room for none.
std::size_t columns_within(const Device& device, const StreamShape& shape, SvdTarget target,
                           std::size_t beside, std::size_t memory);

}  // namespace weft
