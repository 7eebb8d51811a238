// The modes of a BTF tensor T[v, l, y, x, c], by the letters that options and files call them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "weft/btf/btf.hpp"

namespace weft {

// In storage order, slowest first.
enum class Mode : std::uint8_t { view, light, row, column, channel };

inline constexpr std::size_t mode_count = 5;
inline constexpr std::array<Mode, mode_count> all_modes{Mode::view, Mode::light, Mode::row,
                                                        Mode::column, Mode::channel};

constexpr std::size_t index_of(Mode mode) {
  return static_cast<std::size_t>(mode);
}

// "v" "l" "y" "x" "c".
std::string_view name_of(Mode mode);

// The inverse. Throws an input error that names `option` and the value.
Mode mode_from_name(std::string_view name, std::string_view option);

// Indices that a mode takes: V, L, Y, X or C.
std::size_t mode_size(const BtfShape& shape, Mode mode);

// All modes in an order, "x,y,c,v,l". Throws an input error that names `option` and what is wrong.
using ModeOrder = std::array<Mode, mode_count>;
ModeOrder parse_order(std::string_view text, std::string_view option);
std::string to_text(const ModeOrder& order);

}  // namespace weft
