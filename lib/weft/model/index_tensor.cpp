#include "weft/model/index_tensor.hpp"

#include <cstring>

namespace weft {
namespace {

template <typename T>
T element(std::span<const std::byte> bytes, std::size_t i) {
  T value;
  std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
  return value;
}

template <typename T>
void set_element(std::span<std::byte> bytes, std::size_t i, std::uint32_t index) {
  const T value = static_cast<T>(index);
  std::memcpy(bytes.data() + i * sizeof(T), &value, sizeof(T));
}

}  // namespace

IndexTensor::IndexTensor(std::span<const std::uint32_t> indices, std::size_t limit)
    : size_(indices.size()),
      dtype_(limit <= 0x100     ? DType::u8
             : limit <= 0x10000 ? DType::u16
                                : DType::u32),
      bytes_(size_ * size_of(dtype_)) {
  for (std::size_t i = 0; i < size_; ++i) {
    if (dtype_ == DType::u8) {
      set_element<std::uint8_t>(bytes_, i, indices[i]);
    } else if (dtype_ == DType::u16) {
      set_element<std::uint16_t>(bytes_, i, indices[i]);
    } else {
      set_element<std::uint32_t>(bytes_, i, indices[i]);
    }
  }
}

std::size_t IndexTensor::operator[](std::size_t i) const {
  if (dtype_ == DType::u8) return element<std::uint8_t>(bytes_, i);
  if (dtype_ == DType::u16) return element<std::uint16_t>(bytes_, i);
  return element<std::uint32_t>(bytes_, i);
}

}  // namespace weft
