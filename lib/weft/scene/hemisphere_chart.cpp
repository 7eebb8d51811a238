#include "weft/scene/hemisphere_chart.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace weft {

using std::numbers::pi;

std::array<double, 3> hemisphere_of_square(const std::array<double, 2>& place) {
  const double a = 2 * place[0] - 1, b = 2 * place[1] - 1;
  // The larger coordinate is the radius, with its sign; the smaller one turns.
  const bool along_a = std::abs(a) > std::abs(b);
  const double radius = along_a ? a : b;
  if (radius == 0) return {0, 0, 1};
  const double angle = along_a ? pi / 4 * (b / a) : pi / 2 - pi / 4 * (a / b);
  const double z = 1 - radius * radius;
  const double sine = radius * std::sqrt(std::max(0.0, 1 + z));  // sqrt(1 - z^2), signed
  return {sine * std::cos(angle), sine * std::sin(angle), std::max(z, 0.0)};
}

std::array<double, 2> square_of_hemisphere(const std::array<double, 3>& d) {
  const double z = std::max(d[2], 0.0);
  // 1 - z without cancellation at the pole
  const double radius = std::min(1.0, std::sqrt((d[0] * d[0] + d[1] * d[1]) / (1 + z)));
  const double x = std::abs(d[0]), y = std::abs(d[1]);
  double a = 0, b = 0;
  if (x > y) {
    a = radius;
    b = radius * std::atan(y / x) * 4 / pi;
  } else if (y > 0) {
    b = radius;
    a = radius * std::atan(x / y) * 4 / pi;
  }
  const auto coordinate = [](double value, double sign) {
    return std::clamp((std::copysign(value, sign) + 1) / 2, 0.0, 1.0);
  };
  return {coordinate(a, d[0]), coordinate(b, d[1])};
}

}  // namespace weft
