// A model's list of indices in the smallest of U8, U16 and U32 that holds them all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/tensor/dtype.hpp"

namespace weft {

class IndexTensor {
 public:
  IndexTensor() = default;
  // `limit`: every index is below it. It decides the type, so that the type does not depend on
  // which indices occur.
  IndexTensor(std::span<const std::uint32_t> indices, std::size_t limit);

  std::size_t size() const { return size_; }
  std::size_t operator[](std::size_t i) const;

  DType dtype() const { return dtype_; }
  std::span<const std::byte> bytes() const { return bytes_; }

 private:
  std::size_t size_ = 0;
  DType dtype_ = DType::u8;
  std::vector<std::byte> bytes_;
};

}  // namespace weft
