// A tensor in host memory, or in a file beyond what that may hold, whose Gram matrices and mode
// products are made by a device, block by block: it need not fit the device's memory or its largest
// allocation. A device that shares the host's memory reads the blocks where they lie.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/ops/mode_product.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {

class HeldTensor {
 public:
  HeldTensor() = default;
  HeldTensor(std::vector<std::size_t> tensor_sizes, FloatStore::Place place);

  std::vector<std::size_t> sizes;
  FloatStore values;  // row-major

  // T_(n) T_(n)^T.
  std::vector<double> gram(Device& device, std::size_t mode, Arithmetic arithmetic) const;

  // T x_n U^T with U [size][rank] row-major, in place.
  void project(Device& device, std::size_t mode, std::size_t rank, const std::vector<float>& U);

  // The same in a tensor of its own, in memory.
  HeldTensor projected(Device& device, std::size_t mode, std::size_t rank,
                       const std::vector<float>& U) const;

  // sum of squares, in double.
  double squares() const;

  // Most bytes that either takes beside a tensor of so many values, for modes no longer than
  // `longest`.
  static std::size_t working_bytes(const Device& device, std::size_t values, std::size_t longest,
                                   Arithmetic arithmetic);

 private:
  void project_slabs(Device& device, const ops::ModeView& view, std::size_t at_once,
                     std::size_t rank, const Buffer& factor, Buffer& out);
  void project_parts(Device& device, const ops::ModeView& view, std::size_t at_once,
                     std::size_t rank, const Buffer& factor, Buffer& out);
};

}  // namespace weft
