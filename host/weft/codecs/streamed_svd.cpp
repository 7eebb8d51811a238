#include "weft/codecs/streamed_svd.hpp"

#include <algorithm>
#include <utility>

#include "weft/codecs/krylov_basis.hpp"
#include "weft/codecs/svd_methods.hpp"
#include "weft/codecs/svd_projection.hpp"
#include "weft/error.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/syrk.hpp"

namespace weft {
namespace {

// The basis and the products of `columns` directions.
std::size_t factor_bytes(const Device& device, const StreamShape& shape, std::size_t columns) {
  return (shape.rows + shape.columns) *
         ops::round_up(columns, ops::panel_width(device, shape.arithmetic)) *
         size_of(shape.arithmetic);
}

}  // namespace

StreamedSvd streamed_svd(Device& device, PanelStream& stream, const SvdTarget& target, Job& job) {
  ops::require_arithmetic(device, stream.arithmetic());
  const bool dense = target.method == SvdMethod::gram || target.method == SvdMethod::qr;
  if (dense && stream.columns() > most_dense_columns) {
    fail_input("--svd {}: the short side of the matrix is {}, at most {} are taken",
               name_of(target.method), stream.columns(), most_dense_columns);
  }
  switch (target.method) {
    case SvdMethod::gram:
      return svd_gram(device, stream, target, job);
    case SvdMethod::qr:
      return svd_qr(device, stream, target, job);
    default:
      return svd_randomized(device, stream, target, job);
  }
}

MemoryPlan plan_streamed_svd(const Device& device, const StreamShape& shape,
                             const SvdTarget& target) {
  const std::size_t smaller = std::min(shape.rows, shape.columns);
  const std::size_t longer = std::max(shape.rows, shape.columns);
  const std::size_t m = shape.columns;
  std::size_t kept = std::min(target.rank > 0 ? target.rank : smaller, smaller);
  if (target.has_goal()) kept = std::min(kept, target.most_columns);
  MemoryPlan plan;
  std::size_t widest = kept;  // block that is one buffer
  if (target.method == SvdMethod::randomized) {
    const std::size_t block = randomized_block(device, shape, target);
    if (target.has_goal()) {
      const std::size_t total = std::min(m, std::max(target.most_columns, block));
      widest = std::max(block, total);
      plan.add("Krylov basis",
               KrylovBasis::bytes(device, shape, std::max(block, total / 2), total));
    } else {
      widest = std::max(block, kept);
      plan.add("Krylov basis",
               KrylovBasis::bytes(device, shape, block, (KrylovBasis::most_blocks + 1) * block));
    }
  } else {
    // The first pass, and what follows when its buffers are gone.
    MemoryPlan first;
    if (target.method == SvdMethod::gram) {
      first.add("Gram matrix", m * m * size_of(shape.arithmetic) +
                                   ops::syrk_bytes(device, m, shape.granule, shape.arithmetic));
    } else {
      first.add("QR", ops::Tsqr::bytes(device, m, shape.arithmetic, target.workspace));
    }
    if (target.method == SvdMethod::gram) {
      // the eigensolver's matrix, its vectors and their copies; of these, the vectors stay
      first.add("small problem", 6 * m * m * sizeof(double));
      plan.add("small problem", m * m * sizeof(double));
    } else {
      first.add("small problem", m * m * sizeof(double));
      // the SVD by divide and conquer, its check and its copies: 12 matrices, and the triangle
      plan.add("small problem", 13 * m * m * sizeof(double));
    }
    // the basis, packed and transposed too, and the products before they are turned
    plan.add("projection", row_major_bytes(device, shape.rows + m, kept, shape.arithmetic) +
                               2 * factor_bytes(device, {m, 0, 0, shape.arithmetic}, kept) +
                               2 * ops::gram_bytes(shape.rows, kept, kept) +
                               13 * kept * kept * sizeof(double));
    plan.add("factors", row_major_bytes(device, shape.rows + m, kept, shape.arithmetic));
    if (first.total() > plan.total()) plan = std::move(first);
  }
  if (target.method == SvdMethod::randomized) {
    plan.add("factors", factor_bytes(device, shape, kept));
  }
  // No driver gives more in one piece, whatever the plan allows.
  const std::size_t piece = factor_bytes(device, {longer, 0, 0, shape.arithmetic}, widest);
  const std::size_t largest = device.limits().largest_allocation;
  if (piece > largest && !target.has_goal()) {
    fail_input("rank {}: a block of the basis takes {} bytes in one piece, {} gives at most {}",
               target.rank, piece, device.limits().name, largest);
  }
  return plan;
}

std::size_t columns_within(const Device& device, const StreamShape& shape, SvdTarget target,
                           std::size_t beside, std::size_t memory) {
  const std::size_t largest = device.limits().largest_allocation;
  const std::size_t longer = std::max(shape.rows, shape.columns);
  const auto fits = [&](std::size_t columns) {
    target.most_columns = columns;
    return plan_streamed_svd(device, shape, target).total() + columns * beside <= memory &&
           factor_bytes(device, {longer, 0, 0, shape.arithmetic}, columns) <= largest;
  };
  std::size_t least = 1;  // fits, or nothing does
  std::size_t beyond = std::min(shape.rows, shape.columns) + 1;
  while (beyond - least > 1) {
    const std::size_t middle = least + (beyond - least) / 2;
    (fits(middle) ? least : beyond) = middle;
  }
  return least;
}

}  // namespace weft
