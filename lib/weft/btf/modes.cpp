#include "weft/btf/modes.hpp"

#include "weft/error.hpp"

namespace weft {

std::string_view name_of(Mode mode) {
  constexpr std::array<std::string_view, mode_count> names{"v", "l", "y", "x", "c"};
  return names[index_of(mode)];
}

Mode mode_from_name(std::string_view name, std::string_view option) {
  for (const Mode mode : all_modes) {
    if (name_of(mode) == name) return mode;
  }
  fail_input("{}: '{}' is none of the modes v, l, y, x, c", option, name);
}

std::size_t mode_size(const BtfShape& shape, Mode mode) {
  const std::array<std::size_t, mode_count> sizes{shape.views, shape.lights, shape.height,
                                                  shape.width, shape.channels};
  return sizes[index_of(mode)];
}

ModeOrder parse_order(std::string_view text, std::string_view option) {
  ModeOrder order{};
  std::array<bool, mode_count> seen{};
  std::string_view rest = text;
  for (std::size_t i = 0; i < mode_count; ++i) {
    const std::size_t comma = rest.find(',');
    const bool last = i + 1 == mode_count;
    if (last != (comma == std::string_view::npos)) {
      fail_input("{} {}: all of v, l, y, x, c are needed, as in x,y,c,v,l", option, text);
    }
    order[i] = mode_from_name(rest.substr(0, comma), fmt::format("{} {}", option, text));
    if (seen[index_of(order[i])]) fail_input("{} {}: '{}' twice", option, text, name_of(order[i]));
    seen[index_of(order[i])] = true;
    if (!last) rest.remove_prefix(comma + 1);
  }
  return order;
}

std::string to_text(const ModeOrder& order) {
  std::string text;
  for (const Mode mode : order) {
    if (!text.empty()) text += ',';
    text += name_of(mode);
  }
  return text;
}

}  // namespace weft
