// Indices in as few bits as hold them: of n things, ceil(log2 n) bits each and at least one, one
// behind the other from the low bits of the first byte on; what is left of the last byte is zero.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace weft {

class PackedIndices {
 public:
  PackedIndices() = default;
  // `limit`: every index is below it. It decides the bits.
  PackedIndices(std::vector<std::uint32_t> indices, std::size_t limit);

  std::size_t size() const { return indices_.size(); }
  std::uint32_t operator[](std::size_t i) const { return indices_[i]; }
  std::span<const std::uint32_t> indices() const { return indices_; }
  // As they are stored.
  std::span<const std::byte> bytes() const { return bytes_; }

  // Bits of each of `limit` things, and bytes of so many of them. `count` is below 2^56.
  static unsigned bits(std::size_t limit);
  static std::size_t packed_size(std::size_t count, std::size_t limit);

  // The indices of packed bytes. Throws an input error that begins with `where` for another number
  // of bytes, an index that is not below the limit, or bits behind the last.
  static PackedIndices unpack(std::span<const std::uint32_t> bytes, std::size_t count,
                              std::size_t limit, std::string_view where);

 private:
  std::vector<std::uint32_t> indices_;
  std::vector<std::byte> bytes_;
};

}  // namespace weft
