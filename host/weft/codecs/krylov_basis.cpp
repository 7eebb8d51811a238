#include "weft/codecs/krylov_basis.hpp"

#include <algorithm>
#include <utility>

#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/orthonormalise.hpp"
#include "weft/ops/reals.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"

namespace weft {

KrylovBasis::KrylovBasis(Device& device, std::size_t rows, std::size_t columns, std::size_t block,
                         Arithmetic arithmetic, std::uint64_t seed)
    : device_(device), rows_(rows), columns_(columns), arithmetic_(arithmetic), seed_(seed) {
  // Y^T random, then orthonormalised like any other block
  grow(block, false);
}

std::size_t KrylovBasis::padded(std::size_t columns) const {
  return ops::round_up(columns, ops::panel_width(device_, arithmetic_));
}

std::size_t KrylovBasis::bytes(const Device& device, const StreamShape& shape, std::size_t block,
                               std::size_t total) {
  const std::size_t width = ops::panel_width(device, shape.arithmetic);
  const std::size_t size = size_of(shape.arithmetic);
  const std::size_t padded_block = ops::round_up(block, width);
  // all blocks, each of whole panels; what is taken of them, the next one, Y (twice as it grows)
  // and the scratch block
  const std::size_t padded_total = ops::ceil_div(total, block) * padded_block;
  const std::size_t vectors = padded_total * (shape.rows + shape.columns) * size +
                              padded_block * (shape.rows + 5 * shape.columns) * size;
  // W^T W, its successor, and the eigensolver's copies, in double
  const std::size_t small = 5 * total * total * sizeof(double);
  return vectors + small + 2 * ops::gram_bytes(std::max(shape.rows, shape.columns), block, block);
}

std::size_t KrylovBasis::dimension() const {
  std::size_t sum = 0;
  for (const Block& block : blocks_) sum += block.columns;
  return sum;
}

void KrylovBasis::begin_pass() {
  Block& block = blocks_.back();
  block.W = Buffer(device_, rows_ * padded(block.width) * size_of(arithmetic_), "Krylov products");
  // Products leave the columns beyond the block's width alone.
  device_.fill_zero(block.W, 0, block.W.size());
}

void KrylovBasis::multiply(const Buffer& panels, std::size_t first, std::size_t count) {
  Block& block = blocks_.back();
  const std::size_t leading = padded(block.width);
  const std::size_t offset = first * leading;
  ops::gemm_packed(device_, count, block.width, columns_, 1.0,
                   ops::panelled(device_, panels, count, arithmetic_), block.Q, 0.0,
                   ops::to_row_major(device_, block.W, leading, offset, arithmetic_));
  ops::gemm_packed(device_, block.width, columns_, count, 1.0,
                   ops::transposed(device_, block.W, leading, offset, arithmetic_), panels,
                   first == 0 ? 0.0 : 1.0,
                   ops::to_row_major(device_, Y_, columns_, 0, arithmetic_));
}

std::vector<double> KrylovBasis::energies() {
  // the new block's rows and columns of H
  const Block& newest = blocks_.back();
  const std::size_t total = dimension();
  const std::size_t known = total - newest.columns;
  std::vector<double> H(total * total, 0.0);
  for (std::size_t i = 0; i < known; ++i) {
    std::copy_n(H_.data() + i * known, known, H.data() + i * total);
  }
  std::size_t row = 0;
  const ops::Columns newest_columns =
      ops::row_major_columns(device_, newest.W, padded(newest.width), newest.columns, arithmetic_);
  for (const Block& block : blocks_) {
    const std::vector<double> products = ops::gram(
        device_, rows_,
        ops::row_major_columns(device_, block.W, padded(block.width), block.columns, arithmetic_),
        newest_columns);
    for (std::size_t i = 0; i < block.columns; ++i) {
      for (std::size_t j = 0; j < newest.columns; ++j) {
        const double value = products[i * newest.columns + j];
        H[(row + i) * total + known + j] = value;
        H[(known + j) * total + row + i] = value;
      }
    }
    row += block.columns;
  }
  H_ = std::move(H);
  reference::SymmetricEigen eigen = reference::symmetric_eigen(total, H_);
  values_ = std::move(eigen.values);
  vectors_ = std::move(eigen.vectors);
  return values_;
}

Buffer KrylovBasis::combine(bool Q, std::size_t k, bool panels) {
  const std::size_t rows = Q ? columns_ : rows_;
  const std::size_t leading = padded(k);
  const std::size_t total = dimension();
  Buffer out(device_, rows * leading * size_of(arithmetic_), "singular vectors");
  std::size_t row = 0;
  for (const Block& block : blocks_) {
    std::vector<double> part(block.columns * k);
    for (std::size_t i = 0; i < block.columns; ++i) {
      std::copy_n(vectors_.data() + (row + i) * total, k, part.data() + i * k);
    }
    const Buffer small = ops::real_buffer(device_, part, arithmetic_, "basis change");
    Buffer packed(device_, block.columns * leading * size_of(arithmetic_), "basis change");
    ops::pack_panels(device_, ops::row_major(device_, small, k, 0, arithmetic_), block.columns, k,
                     packed);
    const ops::Operand A =
        Q ? ops::panelled(device_, block.Q, columns_, arithmetic_)
          : ops::row_major(device_, block.W, padded(block.width), 0, arithmetic_);
    const ops::Result C = panels ? ops::to_panels(device_, out, rows, arithmetic_)
                                 : ops::to_row_major(device_, out, leading, 0, arithmetic_);
    ops::gemm_packed(device_, rows, leading, block.columns, 1.0, A, packed, row == 0 ? 0.0 : 1.0,
                     C);
    row += block.columns;
  }
  device_.finish();
  return out;
}

Buffer KrylovBasis::vectors(std::size_t k) {
  return combine(true, k, false);
}

Buffer KrylovBasis::products(std::size_t k) {
  return combine(false, k, false);
}

void KrylovBasis::cut_back(std::size_t columns) {
  Block best;
  best.columns = std::min(columns, dimension());
  best.width = best.columns;
  best.Q = combine(true, best.columns, true);
  best.W = combine(false, best.columns, false);
  blocks_.clear();
  H_.assign(best.columns * best.columns, 0.0);
  for (std::size_t i = 0; i < best.columns; ++i) H_[i * best.columns + i] = values_[i];
  blocks_.push_back(std::move(best));
}

void KrylovBasis::add_random(std::size_t extra) {
  if (extra == 0) return;
  const std::size_t known = y_rows_ * columns_;
  std::vector<double> values(known + extra * columns_);
  if (known > 0) {
    ops::read_reals(device_, Y_, arithmetic_, y_rows_, columns_, columns_, 1.0,
                    std::span(values).first(known));
  }
  std::vector<float> random(extra * columns_);
  reference::fill_random(seed_ + random_blocks_++, random);
  std::copy(random.begin(), random.end(), values.begin() + static_cast<std::ptrdiff_t>(known));
  Y_ = ops::real_buffer(device_, values, arithmetic_, "Krylov block");
  y_rows_ += extra;
}

bool KrylovBasis::grow(std::size_t extra, bool bounded) {
  if (dimension() >= columns_) return false;
  y_rows_ = blocks_.empty() ? 0 : blocks_.back().width;
  add_random(extra);
  const std::size_t width = y_rows_;
  const std::size_t bytes = padded(width) * columns_ * size_of(arithmetic_);
  Buffer next(device_, bytes, "Krylov block");
  Buffer scratch(device_, bytes, "Krylov block");
  ops::pack_panels(device_, ops::transposed(device_, Y_, columns_, 0, arithmetic_), columns_, width,
                   next);
  // Orthogonal to all earlier blocks, twice, since one projection leaves their rounding. What the
  // second takes away was nothing but that.
  std::size_t rank = 0;
  for (int round = 0; round < (blocks_.empty() ? 1 : 2); ++round) {
    for (const Block& block : blocks_) {
      ops::project_out(device_, columns_, block.Q, block.columns, next, width, arithmetic_);
    }
    rank = ops::orthonormalise(device_, columns_, width, next, scratch, arithmetic_,
                               round == 0 ? 0 : 0.5);
  }
  if (rank == 0) return false;
  if (bounded && blocks_.size() == most_blocks) cut_back(width);
  Block block;
  block.Q = std::move(next);
  block.width = width;
  block.columns = rank;
  blocks_.push_back(std::move(block));
  return true;
}

}  // namespace weft
