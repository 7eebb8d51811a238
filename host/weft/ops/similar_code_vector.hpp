// The most similar code-vector of each of many vectors on the device:
// kernels/similar_code_vector.cl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/reference/similar_code_vector.hpp"

namespace weft::ops {

// A search whose code-vectors stay on the device, in several buffers where one would be too large.
// Dissimilarities are in float: code-vectors that differ by less may stand for each other.
class DeviceSimilarSearch final : public SimilarSearch {
 public:
  explicit DeviceSimilarSearch(Device& device) : device_(device) {}

  void set(const VectorShape& shape, std::span<const float> code_vectors) override;
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors, double most) override;

  // Bytes of device memory for so many code-vectors, and of vectors at a time with their copies on
  // the host.
  static std::size_t bytes(const Device& device, const VectorShape& shape, std::size_t code_vectors,
                           std::size_t vectors);

 private:
  struct Part {
    std::size_t first = 0;  // number of the first code-vector
    std::size_t count = 0;
    Buffer rows;
  };

  bool is_short() const;
  std::size_t row_floats() const;

  Device& device_;
  VectorShape shape_;
  std::vector<Part> parts_;
};

}  // namespace weft::ops
