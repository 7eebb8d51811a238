#include "weft/scene/studio_map.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace weft {
namespace {

constexpr std::size_t rows = 64, columns = 128;

struct Lamp {
  double theta, phi;  // degrees
  double width;       // degrees from the middle to 1/e
  double radiance;    // in the middle
};
constexpr std::array<Lamp, 2> lamps{Lamp{60, -35, 28, 1.1}, Lamp{62, 105, 20, 1.6}};

double radiance_from(double theta, double phi) {
  const double z = std::cos(theta);
  const double up = (z + 1) / 2;
  double radiance = 0.06 + 0.22 * up * up;
  for (const Lamp& lamp : lamps) {
    constexpr double degree = std::numbers::pi / 180;
    const double cosine = z * std::cos(lamp.theta * degree) + std::sin(theta) *
                                                                  std::sin(lamp.theta * degree) *
                                                                  std::cos(phi - lamp.phi * degree);
    // exp(-(angle / width)^2) for small angles, without a crease at the opposite side
    const double width = lamp.width * degree;
    radiance += lamp.radiance * std::exp(2 * (cosine - 1) / (width * width));
  }
  return radiance;
}

}  // namespace

EnvironmentMap make_studio_map() {
  constexpr double pi = std::numbers::pi;
  std::vector<float> radiance;
  radiance.reserve(rows * columns * 3);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const double theta = pi * (static_cast<double>(row) + 0.5) / rows;
      const double phi = pi - 2 * pi * (static_cast<double>(column) + 0.5) / columns;
      radiance.insert(radiance.end(), 3, static_cast<float>(radiance_from(theta, phi)));
    }
  }
  return {rows, columns, std::move(radiance), "studio"};
}

}  // namespace weft
