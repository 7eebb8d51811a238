#include "weft/model/packed_indices.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "weft/error.hpp"

namespace weft {

PackedIndices::PackedIndices(std::vector<std::uint32_t> indices, std::size_t limit)
    : indices_(std::move(indices)), bytes_(packed_size(indices_.size(), limit)) {
  const unsigned width = bits(limit);
  std::size_t at = 0;  // bit
  for (const std::uint32_t index : indices_) {
    for (unsigned b = 0; b < width;) {
      // as many bits as are left of this byte
      const unsigned shift = at % 8;
      const unsigned taken = std::min(width - b, 8 - shift);
      const std::uint32_t part = (index >> b) & ((1U << taken) - 1);
      bytes_[at / 8] |= static_cast<std::byte>(part << shift);
      b += taken;
      at += taken;
    }
  }
}

unsigned PackedIndices::bits(std::size_t limit) {
  return limit <= 2 ? 1 : static_cast<unsigned>(std::bit_width(limit - 1));
}

std::size_t PackedIndices::packed_size(std::size_t count, std::size_t limit) {
  return (count * bits(limit) + 7) / 8;
}

PackedIndices PackedIndices::unpack(std::span<const std::uint32_t> bytes, std::size_t count,
                                    std::size_t limit, std::string_view where) {
  if (bytes.size() != packed_size(count, limit)) {
    fail_input("{}: {} bytes for {} indices of {} bits", where, bytes.size(), count, bits(limit));
  }
  const unsigned width = bits(limit);
  std::vector<std::uint32_t> indices(count);
  std::size_t at = 0;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t index = 0;
    for (unsigned b = 0; b < width;) {
      const unsigned shift = at % 8;
      const unsigned taken = std::min(width - b, 8 - shift);
      index |= std::uint64_t{(bytes[at / 8] >> shift) & ((1U << taken) - 1)} << b;
      b += taken;
      at += taken;
    }
    if (index >= limit) {
      fail_input("{}: index {} of entry {} is not below {}", where, index, i, limit);
    }
    indices[i] = static_cast<std::uint32_t>(index);
  }
  if (at % 8 != 0 && (bytes.back() >> (at % 8)) != 0) {
    fail_input("{}: bits behind the last of {} indices", where, count);
  }
  return {std::move(indices), limit};
}

}  // namespace weft
