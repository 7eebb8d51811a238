#include "weft/codecs/krylov_basis.hpp"

#include <algorithm>
#include <utility>

#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/orthonormalise.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {
constexpr std::size_t float_bytes = sizeof(float);
}

KrylovBasis::KrylovBasis(Device& device, std::size_t texels, std::size_t n, std::size_t block,
                         std::uint64_t seed)
    : device_(device),
      texels_(texels),
      n_(n),
      block_(block),
      padded_(ops::round_up(block, ops::panel_width(device))),
      Y_(device, block * texels * float_bytes, "Krylov block"),
      scratch_(device, padded_ * texels * float_bytes, "Krylov block") {
  // Y^T random, then orthonormalised like any other block
  std::vector<float> random(block * texels);
  reference::fill_random(seed, random);
  device_.write(Y_, std::span<const float>(random));
  grow();
}

std::size_t KrylovBasis::bytes(const Device& device, std::size_t texels, std::size_t n,
                               std::size_t block) {
  const std::size_t padded = ops::round_up(block, ops::panel_width(device));
  // the blocks, one more while they are cut back, the next one, Y and the scratch block
  const std::size_t vectors =
      ((most_blocks + 1) * (texels + n) + 3 * texels) * padded * float_bytes;
  // W^T W, its successor, and the eigensolver's copies, in double
  const std::size_t columns = most_blocks * block;
  const std::size_t small = 5 * columns * columns * sizeof(double);
  return vectors + small + 2 * ops::gram_bytes(std::max(texels, n), block, block);
}

std::size_t KrylovBasis::columns() const {
  std::size_t sum = 0;
  for (const Block& block : blocks_) sum += block.columns;
  return sum;
}

void KrylovBasis::begin_pass() {
  blocks_.back().W = Buffer(device_, n_ * padded_ * float_bytes, "Krylov products");
}

void KrylovBasis::multiply(const Buffer& panels, std::size_t first, std::size_t count) {
  Block& block = blocks_.back();
  const std::size_t offset = first * padded_;
  ops::gemm_packed(device_, count, padded_, texels_, 1.0f, ops::panelled(device_, panels, count),
                   block.Q, 0.0f, ops::to_row_major(device_, block.W, padded_, offset));
  ops::gemm_packed(device_, block_, texels_, count, 1.0f,
                   ops::transposed(device_, block.W, padded_, offset), panels,
                   first == 0 ? 0.0f : 1.0f, ops::to_row_major(device_, Y_, texels_));
}

std::vector<double> KrylovBasis::energies() {
  // the new block's rows and columns of H
  const Block& newest = blocks_.back();
  const std::size_t total = columns();
  const std::size_t known = total - newest.columns;
  std::vector<double> H(total * total, 0.0);
  for (std::size_t i = 0; i < known; ++i) {
    std::copy_n(H_.data() + i * known, known, H.data() + i * total);
  }
  std::size_t row = 0;
  const ops::Columns newest_columns =
      ops::row_major_columns(device_, newest.W, padded_, newest.columns);
  for (const Block& block : blocks_) {
    const std::vector<double> products =
        ops::gram(device_, n_, ops::row_major_columns(device_, block.W, padded_, block.columns),
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

void KrylovBasis::combine(bool left, const std::vector<double>& X, std::size_t k, Buffer& out,
                          bool packed) {
  const std::size_t rows = left ? texels_ : n_;
  const std::size_t width = packed ? padded_ : k;
  std::size_t row = 0;
  for (const Block& block : blocks_) {
    const std::vector<float> part(
        X.begin() + static_cast<std::ptrdiff_t>(row * k),
        X.begin() + static_cast<std::ptrdiff_t>((row + block.columns) * k));
    Buffer small(device_, part.size() * float_bytes, "basis change");
    device_.write(small, std::span<const float>(part));
    Buffer panels(device_, ops::packed_elements(device_, block.columns, k) * float_bytes,
                  "basis change");
    ops::pack_panels(device_, ops::row_major(device_, small, k), block.columns, k, panels);
    const ops::Operand A =
        left ? ops::panelled(device_, block.Q, texels_) : ops::row_major(device_, block.W, padded_);
    const ops::Result C = packed && left ? ops::to_panels(device_, out, rows)
                                         : ops::to_row_major(device_, out, width);
    ops::gemm_packed(device_, rows, packed ? padded_ : k, block.columns, 1.0f, A, panels,
                     row == 0 ? 0.0f : 1.0f, C);
    row += block.columns;
  }
  device_.finish();
}

std::size_t KrylovBasis::result(std::size_t rank, double right_scale, std::vector<float>& left,
                                std::vector<float>& right) {
  const std::size_t total = columns();
  const double floor = values_[0] * 0x1p-46;
  std::size_t k = 0;
  while (k < std::min(rank, total) && values_[k] > floor) ++k;
  std::vector<double> X(total * k);
  for (std::size_t i = 0; i < total; ++i) {
    std::copy_n(vectors_.data() + i * total, k, X.data() + i * k);
  }
  left.resize(texels_ * k);
  right.resize(n_ * k);
  Buffer out(device_, std::max(texels_, n_) * k * float_bytes, "singular vectors");
  combine(true, X, k, out, false);
  device_.read(out, std::span<float>(left));
  combine(false, X, k, out, false);
  device_.read(out, std::span<float>(right));
  for (float& value : right) value = static_cast<float>(value * right_scale);
  return k;
}

void KrylovBasis::compress() {
  const std::size_t total = columns();
  const std::size_t k = std::min(block_, total);
  std::vector<double> X(total * k);
  for (std::size_t i = 0; i < total; ++i) {
    std::copy_n(vectors_.data() + i * total, k, X.data() + i * k);
  }
  Block best;
  best.columns = k;
  best.Q = Buffer(device_, texels_ * padded_ * float_bytes, "Krylov block");
  best.W = Buffer(device_, n_ * padded_ * float_bytes, "Krylov products");
  combine(true, X, k, best.Q, true);
  combine(false, X, k, best.W, true);
  blocks_.clear();
  blocks_.push_back(std::move(best));
  H_.assign(k * k, 0.0);
  for (std::size_t i = 0; i < k; ++i) H_[i * k + i] = values_[i];
}

bool KrylovBasis::grow() {
  if (columns() >= texels_) return false;
  Buffer next(device_, padded_ * texels_ * float_bytes, "Krylov block");
  ops::pack_panels(device_, ops::transposed(device_, Y_, texels_), texels_, block_, next);
  // Orthogonal to all earlier blocks, twice, since one projection leaves their rounding.
  std::size_t rank = 0;
  for (int round = 0; round < (blocks_.empty() ? 1 : 2); ++round) {
    for (const Block& block : blocks_) {
      ops::project_out(device_, texels_, block.Q, block.columns, next, block_);
    }
    rank = ops::orthonormalise(device_, texels_, block_, next, scratch_);
  }
  if (rank == 0) return false;
  if (blocks_.size() == most_blocks) compress();
  Block block;
  block.Q = std::move(next);
  block.columns = rank;
  blocks_.push_back(std::move(block));
  return true;
}

}  // namespace weft
