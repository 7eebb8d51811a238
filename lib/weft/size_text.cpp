#include "weft/size_text.hpp"

#include <array>
#include <charconv>
#include <cmath>

#include "weft/error.hpp"

namespace weft {
namespace {

struct Unit {
  std::string_view name;
  double bytes;
};
constexpr double kibi = 1024.0;
constexpr std::array units{
    Unit{"", 1.0},
    Unit{"B", 1.0},
    Unit{"K", kibi},
    Unit{"KiB", kibi},
    Unit{"kB", 1e3},
    Unit{"M", kibi* kibi},
    Unit{"MiB", kibi* kibi},
    Unit{"MB", 1e6},
    Unit{"G", kibi* kibi* kibi},
    Unit{"GiB", kibi* kibi* kibi},
    Unit{"GB", 1e9},
    Unit{"T", kibi* kibi* kibi* kibi},
    Unit{"TiB", kibi* kibi* kibi* kibi},
    Unit{"TB", 1e12},
};
// Past this no machine has memory, and double arithmetic on sizes stays far from overflow.
constexpr double largest_size = 4611686018427387904.0;  // 2^62

}  // namespace

std::size_t parse_size(std::string_view text, std::string_view option) {
  double number = 0;
  const char* const end = text.data() + text.size();
  // No hexadecimal, no sign, no "inf": only what a person would write as a size.
  const bool starts_with_digit = !text.empty() && text.front() >= '0' && text.front() <= '9';
  const auto parsed = std::from_chars(text.data(), end, number, std::chars_format::fixed);
  if (!starts_with_digit || parsed.ec != std::errc{}) {
    fail_input("{}: '{}' is not a size such as 1GiB, 512MiB or 4000000", option, text);
  }
  const std::string_view suffix(parsed.ptr, static_cast<std::size_t>(end - parsed.ptr));
  for (const Unit& unit : units) {
    if (suffix != unit.name) continue;
    const double bytes = number * unit.bytes;
    if (bytes < 1.0 || bytes > largest_size) {
      fail_input("{}: size '{}' is out of range (1 byte to 2^62 bytes)", option, text);
    }
    return static_cast<std::size_t>(std::llround(bytes));
  }
  fail_input("{}: '{}' has the unknown unit '{}'; known: KiB, MiB, GiB, TiB, kB, MB, GB, TB",
             option, text, suffix);
}

}  // namespace weft
