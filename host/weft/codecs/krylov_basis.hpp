// The growing orthonormal basis Q = [Q_0 Q_1 ...] of a block Krylov iteration on X^T X, on the
// device, with W = X Q and what follows from it. X is K x m, streamed by blocks of rows.
//
//   W_t = X Q_t        Y_t = X^T W_t        Q_{t+1} = orth((I - Q Q^T) Y_t)
//
// and, from the eigenvalues of W^T W, the error of the best rank-k approximation in the basis:
// |X|^2 - sum of the k largest.
//
//   Q_t: packed panels [ceil(l / NR)][m][NR]      l = columns of the block
//   W_t: row-major [K][l rounded up to NR]
//   Y_t: row-major [l][m], transposed
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "weft/codecs/streamed_svd.hpp"
#include "weft/device/device.hpp"

namespace weft {

class KrylovBasis {
 public:
  // X of `rows` x `columns`; the first block is `block` random directions from `seed`.
  KrylovBasis(Device& device, std::size_t rows, std::size_t columns, std::size_t block,
              Arithmetic arithmetic, std::uint64_t seed);

  // Blocks that a basis of bounded size holds before it is cut back.
  static constexpr std::size_t most_blocks = 5;

  // Device memory at its peak, and host memory of the small problems beside it, of a basis of
  // `total` columns whose blocks have at most `block`.
  static std::size_t bytes(const Device& device, const StreamShape& shape, std::size_t block,
                           std::size_t total);

  std::size_t dimension() const;
  // Columns of the newest block.
  std::size_t block() const { return blocks_.back().width; }

  // Begins a pass with the newest block; then rows [first, first + count) of X follow in order, as
  // packed panels [ceil(m / NR)][count][NR]. Enqueues only.
  void begin_pass();
  void multiply(const Buffer& panels, std::size_t first, std::size_t count);

  // After a pass: eigenvalues of W^T W, descending: the energy |X v|^2 of each Ritz vector.
  std::vector<double> energies();

  // After energies(): V (m x k) and X V (K x k) of the leading Ritz vectors, row-major at k rounded
  // up to whole panels.
  Buffer vectors(std::size_t k);
  Buffer products(std::size_t k);

  // Adds the next block: Y, and `extra` random directions. False if nothing is left of them: the
  // basis holds the whole row space. With `bounded`, the basis is cut back to one block of its best
  // directions before it has more than most_blocks.
  bool grow(std::size_t extra, bool bounded);

 private:
  struct Block {
    Buffer Q;
    Buffer W;
    std::size_t width = 0;    // columns that there is room for, a block of Y
    std::size_t columns = 0;  // that are not zero
  };

  // sum over blocks of (Q_t or W_t) S_t with S the leading k eigenvectors; row-major, or panels.
  Buffer combine(bool Q, std::size_t k, bool panels);
  std::size_t padded(std::size_t columns) const;
  void add_random(std::size_t extra);
  void cut_back(std::size_t columns);

  Device& device_;
  std::size_t rows_;
  std::size_t columns_;
  Arithmetic arithmetic_;
  std::uint64_t seed_;
  std::vector<Block> blocks_;
  Buffer Y_;
  std::size_t y_rows_ = 0;
  std::size_t random_blocks_ = 0;  // made so far: each has numbers of its own
  std::vector<double> H_;          // W^T W of all finished blocks
  std::vector<double> values_;     // its eigenvalues
  std::vector<double> vectors_;    // and eigenvectors, row-major
};

}  // namespace weft
