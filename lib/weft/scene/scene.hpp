// A scene to render: a shape that wears a material, a camera and lights.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "weft/scene/camera.hpp"
#include "weft/scene/environment_map.hpp"
#include "weft/scene/shape.hpp"

namespace weft {

class LightTables;

struct DirectionalLight {
  Vector3 direction{0, 0, 1};                 // towards the light, of unit length
  std::array<double, 3> irradiance{1, 1, 1};  // on a plane perpendicular to it
};

// A light from (theta, phi) in degrees, measured from +z and from +x towards +y.
DirectionalLight light_at_degrees(double theta, double phi, std::array<double, 3> irradiance);

// What the directions of an environment's samples are drawn by: its own light; what the material
// reflects; or half of them by each, weighed together by the balance heuristic.
enum class LightSampling : std::uint8_t { light, material, both };
// "light", "material", "both"; throws an input error that names `option`.
LightSampling light_sampling_from_name(std::string_view name, std::string_view option);

struct EnvironmentLight {
  std::shared_ptr<const EnvironmentMap> map;
  double rotation = 0;       // about the z axis, degrees, counter-clockwise as seen from above
  double scale = 1;          // of the radiance
  std::size_t samples = 64;  // per shading point
  LightSampling sampling = LightSampling::light;
  std::shared_ptr<const LightTables> material;  // for all sampling but by light
};

struct Scene {
  Camera camera;
  std::size_t samples = 1;  // rays per pixel
  std::shared_ptr<const Shape> shape;
  std::vector<DirectionalLight> lights;
  EnvironmentLight environment;        // no map: none
  bool show_environment = false;       // behind the shape, in place of the background
  std::array<double, 3> background{};  // radiance
  std::uint64_t seed = 1;              // of the samples of the environment

  // S, the light samples of every shading point.
  std::size_t lights_per_point() const {
    return lights.size() + (environment.map ? environment.samples : 0);
  }
};

// Throws an input error that names the field and the value unless the scene has a shape and at
// least one light, all values are finite, lights and background not negative, directions of unit
// length, counts within [1, 65536], and there are tables of the material if lights are drawn by it.
void validate(const Scene& scene);

}  // namespace weft
