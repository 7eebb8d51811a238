// The nearest code-vector of each of many vectors on the device: kernels/nearest_code_vector.cl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/reference/nearest_code_vector.hpp"

namespace weft::ops {

// A search whose code-vectors stay on the device, in several buffers where one would be too large.
// Code-vectors of which the float score says that they are equally near may stand for each other;
// magnitudes should be about 1.
class DeviceNearestSearch final : public NearestSearch {
 public:
  // Without pruning, every code-vector is looked at: the same indices, later.
  explicit DeviceNearestSearch(Device& device, bool pruning = true)
      : device_(device), pruning_(pruning) {}

  void set(const VectorShape& shape, std::span<const float> code_vectors) override;
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors, double most) override;

  // Bytes of device memory for so many code-vectors, and vectors at a time.
  static std::size_t bytes(const Device& device, const VectorShape& shape, std::size_t code_vectors,
                           std::size_t vectors);

 private:
  struct Part {
    std::size_t first = 0;   // number of the first code-vector
    std::size_t groups = 0;  // of rows
    Buffer packed, squares, numbers, ranges;
    std::vector<float> keys;  // of the first row of each block
  };
  // Rows on the device, half the squares of their two parts, and their order.
  struct Ordered {
    Buffer rows;
    std::vector<float> squares;          // [rows][2]
    std::vector<std::uint32_t> numbers;  // in the order of norms
  };

  // Whether blocks of code-vectors are worth looking at before they are compared.
  bool is_pruned() const;
  Ordered order(std::span<const float> rows, std::span<const float> scales) const;
  Buffer pack(const Ordered& ordered, const Buffer& scales, bool scaled, std::size_t lanes) const;

  Device& device_;
  bool pruning_;
  VectorShape shape_;
  std::vector<Part> parts_;
};

}  // namespace weft::ops
