// TT-SVD of a streamed BTF on the device.
//
// A train is cut off its tensor core by core: a truncated SVD of the unfolding behind the first or
// before the last mode that is left,
//
//   W[(a, i), rest] ~ Q[(a, i), b] W'[b, rest]      or      W[rest, (i, b)] ~ W'[rest, a] Q[a, (i,
//   b)]
//
// gives the core Q, with orthonormal columns or rows, and what is still to be cut, W'. The errors
// of the cuts are orthogonal to each other, whichever ends they are made at: their squares add up
// (Oseledets 2011, theorem 2.2), and each cut may leave its part of what is left of the allowed
// error.
//
// While W' is too large for memory, it is the input, slab by slab, with one end projected onto the
// cores that were cut off (tensor_panels.hpp), and that end is the one whose two outermost modes
// are smaller. A short side up to 4096 is then cut by a Gram matrix or a QR of its own in one pass;
// a longer one, or one that leaves a W' that fits, by streamed_svd.hpp, which measures what is left
// where norms do not resolve it.
#pragma once

#include <cstddef>

#include "weft/btf/tile.hpp"
#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/model/tensor_train.hpp"
#include "weft/reference/tensor_train.hpp"

namespace weft {

struct TtFitOptions {
  ModeOrder order{Mode::column, Mode::row, Mode::channel, Mode::view, Mode::light};
  reference::TrainRequest request;
  // Tensors of at most so many values are taken into memory as they are.
  std::size_t resident_values = std::size_t{16} << 20;
  // Small sides whose cut would leave more values than this, could it drop nothing, are cut by
  // their spectrum alone.
  std::size_t most_left = std::size_t{1} << 28;
};

// What fit_tt will take.
MemoryPlan plan_tt(Device& device, TileSource& source, const TtFitOptions& options, const Job& job);

// Throws input errors for NaN, and an unmet goal where arithmetic or memory do not reach the
// tolerance.
TrainFit fit_tt(Device& device, TileSource& source, const TtFitOptions& options, Job& job);

}  // namespace weft
