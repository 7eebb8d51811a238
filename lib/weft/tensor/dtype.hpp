// Element types of tensors in files and tiles, with the names of the safetensors format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace weft {

enum class DType : std::uint8_t { u8, u16, u32, f16, f32, f64 };

// Bytes of one element.
std::size_t size_of(DType type);

// "U8", "U16", "U32", "F16", "F32", "F64".
std::string_view name_of(DType type);

// The type with that name; nothing if the name is not one of ours.
std::optional<DType> dtype_from_name(std::string_view name);

constexpr bool is_float(DType type) {
  return type >= DType::f16;
}

}  // namespace weft
