// Lists of numbers as options have them: "1,0.5,0.5".
#pragma once

#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>
#include <vector>

namespace weft {

// One number or more from `least` to `largest` with commas between them; none where the text is
// anything else, NaN included.
inline std::optional<std::vector<double>> parse_number_list(std::string_view text, double least,
                                                            double largest) {
  std::vector<double> numbers;
  const char* at = text.data();
  const char* const end = at + text.size();
  for (bool more = true; more; ++at) {
    double value = 0;
    const auto [stop, status] = std::from_chars(at, end, value);
    // written so that NaN fails
    if (status != std::errc() || (stop != end && *stop != ',') ||
        !(value >= least && value <= largest)) {
      return std::nullopt;
    }
    numbers.push_back(value);
    at = stop;
    more = at != end;
  }
  return numbers;
}

}  // namespace weft
