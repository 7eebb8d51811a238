// Sparse coding on the device: orthogonal matching pursuit of many signals in one dictionary
// (kernels/batch_omp.cl). What is computed is defined in weft/reference/batch_omp.hpp; where two
// atoms fit what is left equally well up to rounding, either may be chosen.
//
//   OmpOptions options;
//   options.target.sparsity = 10;
//   BatchOmp omp(device, atoms, dimension, options);
//   omp.set_dictionary({D, dimension});
//   omp.code(signals, {Y, dimension}, {indices, coefficients, counts});
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/reference/batch_omp.hpp"

namespace weft::ops {

// Where correlations come from.
//   gram       updated with the atoms' inner products (Rubinstein, Zibulevsky, Elad 2008), of which
//              there are atoms^2. Signals that float arithmetic can't follow that way, because
//              their residual falls below 1e-3 of their norm or an atom nearly depends on those
//              before, are coded again from their residuals.
//   residual   the product of the residuals and all atoms in every step
//   automatic  gram, unless the inner products would take more than 256 MiB
enum class OmpForm { automatic, gram, residual };

struct OmpOptions {
  OmpTarget target;
  OmpForm form = OmpForm::automatic;
  // panels: a work-item codes signal after signal, for CPU devices; tiles: a work-group does, for
  // GPUs. Of the pursuit, and of the products that it starts from.
  Family family = Family::automatic;
  Family product = Family::automatic;
};

// Codes on the device, k = target.sparsity entries a signal, as in reference::SparseCodes. Signal s
// of a call is written at entry first + s.
struct OmpCodes {
  Buffer& indices;              // uint32 [signals][k]
  Buffer& coefficients;         // float [signals][k], at most the largest float in magnitude
  Buffer& counts;               // uint32 [signals]
  Buffer* residuals = nullptr;  // float [signals], |y - D x|
  std::size_t first = 0;
};

class BatchOmp {
 public:
  // `device` must outlive it. An input error names a size that is 0 or more than 2^24.
  BatchOmp(Device& device, std::size_t atoms, std::size_t dimension, const OmpOptions& options);

  // Bytes that it takes at most, on the device and the host, whatever the number of signals.
  static std::size_t bytes(const Device& device, std::size_t atoms, std::size_t dimension,
                           const OmpOptions& options);

  // Sets the atoms, the rows of D, of any norm.
  void set_dictionary(const ConstMatrix& D);

  // Codes the first `signals` rows of Y, chunk by chunk, so that the correlations of a chunk stay
  // in the caches. A signal's bits are the same whatever the others. Waits for the device.
  void code(std::size_t signals, const ConstMatrix& Y, const OmpCodes& codes);

  // The two halves of code() in the form gram, for whoever has correlations of the atoms divided by
  // their norms, or needs them: C, [signals][row_of_correlations()].
  std::size_t row_of_correlations() const { return sizes_.A; }
  void correlate(std::size_t signals, const ConstMatrix& Y, Buffer& C);
  void code_correlated(std::size_t signals, const ConstMatrix& Y, const Buffer& C,
                       const OmpCodes& codes);

  // Of all signals so far, those in the form gram that were coded again from their residuals.
  std::size_t recoded() const { return recoded_; }

 private:
  // Everything that follows from the sizes alone.
  struct Sizes {
    bool gram = false;
    bool packed = false;  // products by packed panels
    bool tiles = false;
    std::size_t vector_width = 0;
    std::size_t items = 0;         // of a work-group
    std::size_t side = 1;          // signals of a group at the same time
    std::size_t vectors = 0;       // of a work-item in registers
    std::size_t A = 0;             // atoms, padded
    std::size_t dimension_p = 0;   // dimension, padded
    std::size_t steps = 0;         // atoms that a signal can have
    std::size_t l_row = 0;         // steps, padded
    std::size_t chunk = 0;         // signals whose correlations are held
    std::size_t block = 0;         // signals between two looks at what is to be coded again
    std::size_t groups = 0;        // work-groups at a time, each with its scratch
    std::size_t group_floats = 0;  // scratch of a group
    std::size_t batch = 0;         // signals coded from their residuals at a time
  };
  // The buffers, and what is accounted for them.
  struct Item {
    Buffer BatchOmp::*buffer;
    const char* what;
    std::size_t bytes;
  };
  static Sizes sizes_of(const Device& device, std::size_t atoms, std::size_t dimension,
                        const OmpOptions& options);
  static std::vector<Item> items_of(const Device& device, std::size_t dimension,
                                    const Sizes& sizes);

  // Signals of a call: from `first` on, at `in_block` in their block.
  struct Chunk {
    std::size_t first;
    std::size_t in_block;
    std::size_t count;
  };

  cl_kernel kernel(const char* name);
  void product(std::size_t rows, const ConstMatrix& X, Buffer& C);
  void code_blocks(std::size_t signals, const ConstMatrix& Y, const Buffer* C,
                   const OmpCodes& codes);
  void code_chunk(const Chunk& chunk, const ConstMatrix& Y, const Buffer* C, const OmpCodes& block);
  void code_batch(std::span<const std::uint32_t> list, const ConstMatrix& Y, const OmpCodes& block);
  void check_rows(const char* name, std::size_t rows, const ConstMatrix& X) const;
  void check_codes(std::size_t signals, const OmpCodes& codes) const;

  Device& device_;
  std::size_t atoms_;
  std::size_t dimension_;
  OmpOptions options_;
  Sizes sizes_;
  std::size_t recoded_ = 0;
  Buffer units_;
  Buffer packed_;
  Buffer inverse_;
  Buffer gram_;
  Buffer correlations_;
  Buffer scales_;
  Buffer energies_;
  Buffer scratch_;
  Buffer residuals_;  // where the caller wants none
  // state of a batch
  Buffer list_;
  Buffer r_;
  Buffer left_;
  Buffer q_;
  Buffer l_;
  Buffer a_;
  Buffer inverses_;
  Buffer chosen_;
  Buffer count_;
};

}  // namespace weft::ops
