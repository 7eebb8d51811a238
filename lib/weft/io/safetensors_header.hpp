// The JSON header of a safetensors file, as text and as what it says.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "weft/io/safetensors.hpp"

namespace weft {

struct SafetensorsHeader {
  Metadata metadata;
  std::vector<TensorInfo> tensors;  // in order of their offsets
  std::vector<std::size_t> begins;  // relative to the end of the header
};

// The longest header that is read, as in the public format.
inline constexpr std::size_t max_safetensors_header = std::size_t{100} << 20;

// Reads and checks the header against the `data_size` bytes that follow it. Throws an input error
// that names `where`, the tensor and the value.
SafetensorsHeader parse_safetensors_header(std::string_view text, std::size_t data_size,
                                           std::string_view where);

// The header's text, without padding. Throws an input error for a string that is not UTF-8.
std::string format_safetensors_header(const SafetensorsHeader& header, std::string_view where);

// Orders tensors by descending element size, otherwise as given, and places them one after the
// other. Throws an input error for a name that is empty, reserved or given twice, and for sizes
// that overflow.
SafetensorsHeader plan_safetensors(std::vector<TensorInfo> tensors, Metadata metadata,
                                   std::string_view where);

// Bytes of a header that holds `text_bytes` of JSON and `reserve` more, padded so that the data
// behind it and its 8 bytes of length begins at a multiple of 64.
std::size_t padded_header_size(std::size_t text_bytes, std::size_t reserve);

}  // namespace weft
