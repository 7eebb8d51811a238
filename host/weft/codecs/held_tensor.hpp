// A tensor in host memory whose Gram matrices and mode products are made by a device, block by
// block: it need not fit the device's memory or its largest allocation.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/ops/mode_product.hpp"

namespace weft {

class HeldTensor {
 public:
  HeldTensor() = default;
  explicit HeldTensor(std::vector<std::size_t> tensor_sizes);

  std::vector<std::size_t> sizes;
  std::vector<float> values;  // row-major

  // T_(n) T_(n)^T.
  std::vector<double> gram(Device& device, std::size_t mode, Arithmetic arithmetic) const;

  // T x_n U^T with U [size][rank] row-major, in place.
  void project(Device& device, std::size_t mode, std::size_t rank, const std::vector<float>& U);

  // sum of squares, in double.
  double squares() const;

  // Most bytes that either takes beside a tensor of so many values, for modes no longer than
  // `longest`.
  static std::size_t working_bytes(const Device& device, std::size_t values, std::size_t longest,
                                   Arithmetic arithmetic);
};

}  // namespace weft
