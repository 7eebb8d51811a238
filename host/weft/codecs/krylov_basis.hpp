// The growing orthonormal basis K = [Q_0 Q_1 ...] of a block Krylov iteration on A A^T, on the
// device, with W = A^T K and what follows from it; see streamed_svd.hpp for the iteration.
//
//   Q_t: packed panels [ceil(l / NR)][P][NR]      l = block
//   W_t: row-major [n][l rounded up to NR]
//   Y_t: row-major [l][P], transposed
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "weft/device/device.hpp"

namespace weft {

class KrylovBasis {
 public:
  // P texels, n rows, blocks of `block` columns; the first block is random from `seed`.
  KrylovBasis(Device& device, std::size_t texels, std::size_t n, std::size_t block,
              std::uint64_t seed);

  // Device memory at its peak, and host memory of the small problems beside it. A function of the
  // sizes alone: the basis is cut back to one block of its best directions before it grows beyond
  // `most_blocks`.
  static std::size_t bytes(const Device& device, std::size_t texels, std::size_t n,
                           std::size_t block);

  // Begins a pass with the newest block; then rows [first, first + count) of A^T follow in order,
  // as tile panels [ceil(P / NR)][count][NR]. Enqueues only.
  void begin_pass();
  void multiply(const Buffer& panels, std::size_t first, std::size_t count);

  // After a pass: eigenvalues of W^T W, descending: the energy |A^T u|^2 of each Ritz vector.
  std::vector<double> energies();

  // After energies(): the leading Ritz vectors. left [P, k] = K X, right [n, k] = W X times
  // `right_scale`, X the leading eigenvectors of W^T W. Directions whose energy is float rounding
  // of the largest are dropped: returns k <= rank.
  std::size_t result(std::size_t rank, double right_scale, std::vector<float>& left,
                     std::vector<float>& right);

  // Adds the next block. False if what is left of Y is nothing: K holds the whole column space.
  bool grow();

 private:
  static constexpr std::size_t most_blocks = 5;

  struct Block {
    Buffer Q;
    Buffer W;
    std::size_t columns = 0;
  };

  std::size_t columns() const;
  // sum over blocks of (Q_t or W_t) X_t: n_rows x k, X row-major columns() x k.
  void combine(bool left, const std::vector<double>& X, std::size_t k, Buffer& out, bool packed);
  void compress();

  Device& device_;
  std::size_t texels_;
  std::size_t n_;
  std::size_t block_;
  std::size_t padded_;  // block_ rounded up to whole panels
  std::vector<Block> blocks_;
  Buffer Y_;
  Buffer scratch_;
  std::vector<double> H_;        // W^T W of all finished blocks, columns() x columns()
  std::vector<double> values_;   // its eigenvalues
  std::vector<double> vectors_;  // and eigenvectors, row-major
};

}  // namespace weft
