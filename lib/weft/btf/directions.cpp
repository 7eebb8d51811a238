#include "weft/btf/directions.hpp"

#include <charconv>
#include <cmath>
#include <numbers>
#include <span>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr double degree = std::numbers::pi / 180.0;
// Half the opening angle of the cap that even_directions() fills.
constexpr double cap_theta = 75.0;
// Far more directions than any capture has; keeps a mistyped count from becoming a huge allocation.
constexpr std::size_t largest_count = 1'000'000;

struct Ring {
  double theta;
  std::size_t count;
  double phi_offset;
};

std::vector<Direction> directions_of_rings(std::span<const Ring> rings) {
  std::vector<Direction> directions;
  for (const Ring& ring : rings) {
    for (std::size_t i = 0; i < ring.count; ++i) {
      const double phi =
          ring.phi_offset + 360.0 * static_cast<double>(i) / static_cast<double>(ring.count);
      directions.push_back(direction_from_degrees(ring.theta, phi));
    }
  }
  return directions;
}

}  // namespace

Direction direction_from_degrees(double theta, double phi) {
  const double sine = std::sin(theta * degree);
  return {static_cast<float>(sine * std::cos(phi * degree)),
          static_cast<float>(sine * std::sin(phi * degree)),
          static_cast<float>(std::cos(theta * degree))};
}

double theta_degrees(const Direction& direction) {
  // The arc tangent is accurate near the zenith, where the arc cosine is not.
  const double x = direction[0], y = direction[1], z = direction[2];
  return std::atan2(std::hypot(x, y), z) / degree;
}

double phi_degrees(const Direction& direction) {
  const double x = direction[0], y = direction[1];
  if (x == 0 && y == 0) return 0;
  const double phi = std::atan2(y, x) / degree;
  if (phi >= 0) return phi == 0 ? 0 : phi;  // no negative zero
  const double turned = phi + 360;
  return turned < 360 ? turned : 0;  // a tiny negative angle rounds up to 360
}

std::vector<Direction> ubo81_directions() {
  static constexpr Ring rings[] = {{0, 1, 0},   {15, 6, 0},  {30, 12, 0},
                                   {45, 18, 0}, {60, 20, 0}, {75, 24, 0}};
  return directions_of_rings(rings);
}

std::vector<Direction> ubo151_directions() {
  static constexpr Ring rings[] = {{0, 1, 0},       {11, 6, 15}, {23.5, 12, 0},   {30, 12, 15},
                                   {37.5, 12, 0},   {45, 18, 0}, {52.5, 18, 7.5}, {60, 24, 0},
                                   {67.5, 24, 7.5}, {75, 24, 0}};
  return directions_of_rings(rings);
}

std::vector<Direction> even_directions(std::size_t count) {
  if (count < 1) fail_input("a set of directions needs at least 1 direction, not 0");
  if (count == 1) return {direction_from_degrees(0, 0)};
  const double golden_angle = 180.0 * (3.0 - std::sqrt(5.0));
  const double cap_height = 1.0 - std::cos(cap_theta * degree);
  std::vector<Direction> directions;
  directions.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    // Equal steps of the height cut a sphere into zones of equal area.
    const double rank = static_cast<double>(i);
    const double z = 1.0 - cap_height * (rank + 0.5) / static_cast<double>(count);
    directions.push_back(
        direction_from_degrees(std::acos(z) / degree, std::fmod(golden_angle * rank, 360.0)));
  }
  return directions;
}

std::vector<Direction> direction_set(std::string_view name, std::string_view option) {
  if (name == "ubo81") return ubo81_directions();
  if (name == "ubo151") return ubo151_directions();
  std::size_t count = 0;
  const char* const end = name.data() + name.size();
  const auto [stop, status] = std::from_chars(name.data(), end, count);
  if (status != std::errc{} || stop != end || count < 1 || count > largest_count) {
    fail_input("{}: '{}' is not a set of directions: give ubo81, ubo151 or a count from 1 to {}",
               option, name, largest_count);
  }
  return even_directions(count);
}

}  // namespace weft
