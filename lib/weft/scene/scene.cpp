#include "weft/scene/scene.hpp"

#include <cmath>
#include <numbers>
#include <string_view>

#include "weft/error.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

constexpr std::size_t largest_count = 65536;
// Of light: far from where sums of float overflow.
constexpr double brightest = 1e9;

void check_count(std::size_t count, std::string_view field) {
  if (count < 1 || count > largest_count) {
    fail_input("scene: {} {}: must be within 1 and {}", field, count, largest_count);
  }
}

void check_color(const std::array<double, 3>& color, std::string_view field) {
  for (const double x : color) {
    if (!(x >= 0 && x <= brightest)) {
      fail_input("scene: {} ({}, {}, {}): each must be within 0 and {}", field, color[0], color[1],
                 color[2], brightest);
    }
  }
}

}  // namespace

DirectionalLight light_at_degrees(double theta, double phi, std::array<double, 3> irradiance) {
  constexpr double degree = std::numbers::pi / 180;
  const double sine = std::sin(theta * degree);
  return {{sine * std::cos(phi * degree), sine * std::sin(phi * degree), std::cos(theta * degree)},
          irradiance};
}

LightSampling light_sampling_from_name(std::string_view name, std::string_view option) {
  if (name == "light") return LightSampling::light;
  if (name == "material") return LightSampling::material;
  if (name == "both") return LightSampling::both;
  fail_input("{}: '{}' is none of light, material, both", option, name);
}

void validate(const Scene& scene) {
  validate(scene.camera);
  check_count(scene.samples, "samples per pixel");
  if (!scene.shape) fail_input("scene: there is no shape");
  check_color(scene.background, "background");
  for (std::size_t i = 0; i < scene.lights.size(); ++i) {
    const DirectionalLight& light = scene.lights[i];
    if (!(std::abs(length(light.direction) - 1) <= 1e-6)) {
      fail_input("scene: light {}: direction ({}, {}, {}) is no unit vector", i, light.direction[0],
                 light.direction[1], light.direction[2]);
    }
    check_color(light.irradiance, fmt::format("light {}: irradiance", i));
  }
  if (scene.environment.map) {
    check_count(scene.environment.samples, "samples of the environment");
    if (scene.environment.sampling != LightSampling::light && !scene.environment.material) {
      fail_input("scene: lights are drawn by the material, of which there are no tables");
    }
    if (!std::isfinite(scene.environment.rotation)) {
      fail_input("scene: rotation of the environment {}", scene.environment.rotation);
    }
    if (!(scene.environment.scale >= 0 && scene.environment.scale <= brightest)) {
      fail_input("scene: scale of the environment {}: must be within 0 and {}",
                 scene.environment.scale, brightest);
    }
  }
  check_count(scene.lights_per_point(), "lights of a point");
}

}  // namespace weft
