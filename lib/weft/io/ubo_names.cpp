#include "weft/io/ubo_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace weft {
namespace {

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

// The length of "030" or "022.5" at the start; a dot belongs to it only before a digit, so that the
// dot of ".jpg" does not.
std::size_t number_length(std::string_view text) {
  std::size_t end = 0;
  while (end < text.size() && is_digit(text[end])) ++end;
  if (end > 0 && end + 1 < text.size() && text[end] == '.' && is_digit(text[end + 1])) {
    ++end;
    while (end < text.size() && is_digit(text[end])) ++end;
  }
  return end;
}

// "030" for 30, "022.5" for 22.5: three digits before the dot.
std::string padded(double degrees, int decimals) {
  return fmt::format("{:0{}.{}f}", degrees, decimals == 0 ? 3 : 4 + decimals, decimals);
}

double rounded(double degrees, int decimals) {
  const double power = std::pow(10.0, decimals);
  return std::round(degrees * power) / power;
}

}  // namespace

std::optional<NamedDirections> directions_in_name(std::string_view file) {
  file.remove_prefix(file.rfind('/') == std::string_view::npos ? 0 : file.rfind('/') + 1);
  // theta and phi of view and light: tv, pv, tl, pl
  std::array<std::optional<double>, 4> angles;
  for (std::size_t i = 0; i + 2 < file.size(); ++i) {
    const bool at_start = i == 0 || file[i - 1] == ' ' || file[i - 1] == '_' || file[i - 1] == '-';
    const bool is_key =
        (file[i] == 't' || file[i] == 'p') && (file[i + 1] == 'v' || file[i + 1] == 'l');
    if (!at_start || !is_key) continue;
    const std::string_view rest = file.substr(i + 2);
    const std::size_t length = number_length(rest);
    // Behind a number comes a separator, the ending or nothing; 12 digits are more than any angle
    // has.
    if (length == 0 || length > 20) continue;
    if (length < rest.size() && rest[length] != ' ' && rest[length] != '_' && rest[length] != '-' &&
        rest[length] != '.') {
      continue;
    }
    double value = 0;
    std::from_chars(rest.data(), rest.data() + length, value);
    std::optional<double>& angle =
        angles[(file[i] == 'p' ? 1u : 0u) + (file[i + 1] == 'l' ? 2u : 0u)];
    if (angle) return std::nullopt;
    angle = value;
  }
  if (!std::all_of(angles.begin(), angles.end(), [](const auto& angle) { return angle; })) {
    return std::nullopt;
  }
  return NamedDirections{{*angles[0], *angles[1]}, {*angles[2], *angles[3]}};
}

AngleText angle_text(const Direction& direction) {
  constexpr int most_decimals = 9;
  constexpr float tolerance = 0x1p-23f;  // of a float near 1
  const double theta = theta_degrees(direction);
  const double phi = phi_degrees(direction);
  for (int decimals = 0;; ++decimals) {
    const double t = rounded(theta, decimals);
    double p = rounded(phi, decimals);
    if (p >= 360) p = 0;
    const Direction back = direction_from_degrees(t, p);
    bool same = true;
    for (std::size_t i = 0; i < 3; ++i) same &= std::abs(back[i] - direction[i]) <= tolerance;
    if (same || decimals == most_decimals) return {padded(t, decimals), padded(p, decimals)};
  }
}

std::string ubo_file_name(std::size_t index, const Direction& view, const Direction& light,
                          std::string_view ending) {
  const AngleText v = angle_text(view);
  const AngleText l = angle_text(light);
  return fmt::format("tv{0}_pv{1}/{2:05} tl{3} pl{4} tv{0} pv{1}{5}", v.theta, v.phi, index,
                     l.theta, l.phi, ending);
}

}  // namespace weft
