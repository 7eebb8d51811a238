// The triangular factor R of a tall matrix, by Householder reflections over a fixed tree of blocks
// of its rows (TSQR; Demmel, Grigori, Hoemmen & Langou 2012): kernels/tsqr.cl.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// X = Q R of a matrix X with m columns whose rows are added bit by bit; Q is not formed.
//
// R is that of a matrix X + E with |e_j| <= c u |x_j| for every column, u the unit roundoff of the
// arithmetic and c a modest function of m that grows with the logarithm of the number of rows: the
// singular values of R are those of X to within c u |X|. Columns may be of any magnitude up to
// 2^120 in f32 (2^1000 in f64), in one matrix; zero, equal and dependent columns are handled, as
// are fewer rows than columns.
//
// The rows go, by their number, to chains of blocks: chain c of a batch takes rows c b .. (c + 1) b
// and reduces them onto its triangle. After 16 batches the chains' triangles are merged pairwise
// and pass on to a second, and by 16 of those to a third level. All sizes follow from m, the
// arithmetic and the workspace alone: results do not depend on how rows were cut into add()s, nor
// on the number of compute units.
class Tsqr {
 public:
  // lean: fewer chains and smaller blocks, for a factorisation that is rarely needed. It takes less
  // than the host's part of an SVD of R, where that is more than a few hundred KiB; slower on
  // devices of many compute units.
  enum class Workspace { ample, lean };

  // An input error for f64 on a device without double precision.
  Tsqr(Device& device, std::size_t m, Arithmetic arithmetic,
       Workspace workspace = Workspace::ample);

  // Adds K rows, packed panels [ceil(m / NR)][K][NR] with NR = panel_width(device, arithmetic).
  // What is in them past column m is not read. Enqueues only.
  void add(const Buffer& packed, std::size_t K);

  // R of all rows so far, m x m, row-major, zero below the diagonal; diagonal entries are of any
  // sign. Waits for the device. A run-time error if NaN, an infinity or an overflow got into it.
  std::vector<double> R();  // NOLINT(readability-identifier-naming): its name in mathematics

  // Device memory of it, and host memory of R().
  static std::size_t bytes(const Device& device, std::size_t m, Arithmetic arithmetic,
                           Workspace workspace = Workspace::ample);

 private:
  struct Shape {
    std::size_t width = 0;     // NR
    std::size_t panels = 0;    // ceil(m / NR)
    std::size_t chains = 0;    // reduced side by side
    std::size_t rows = 0;      // b, of a chain's block
    std::size_t block = 0;     // elements of a chain's block
    std::size_t triangle = 0;  // elements of a triangle
  };
  static Shape shape_of(const Device& device, std::size_t m, Arithmetic arithmetic,
                        Workspace workspace);

  // Rows of one or several blocks and the triangles that they are reduced onto, in elements.
  struct Operands {
    Buffer* R = nullptr;
    std::size_t r_offset = 0;
    std::size_t r_step = 0;
    Buffer* B = nullptr;
    std::size_t b_offset = 0;
    std::size_t b_step = 0;
  };
  void reduce(const Operands& operands, std::size_t chains, bool triangular, std::size_t rows);
  // Reduces the rows that fill the blocks.
  void reduce_blocks();
  // Merges triangle `from` onto `onto`, and clears it; `count` of them, `step` triangles apart.
  void merge(std::size_t onto, std::size_t from, std::size_t step, std::size_t count);
  void merge_chains();
  void clear(std::size_t first, std::size_t count);
  std::size_t second_level() const { return shape_.chains; }
  std::size_t third_level() const { return shape_.chains + 1; }

  Device& device_;
  std::size_t m_;
  Arithmetic arithmetic_;
  Shape shape_;
  Buffer blocks_;
  Buffer triangles_;             // those of the chains, then of the second and the third level
  Buffer factors_;               // T of every chain
  std::size_t filled_ = 0;       // rows in the blocks
  std::size_t used_chains_ = 0;  // whose triangles hold rows
  std::size_t batches_ = 0;      // in the chains' triangles
  std::size_t in_second_level_ = 0;
  bool third_level_used_ = false;
};

}  // namespace weft::ops
