// A scene to render: a shape that wears a material, a camera and lights.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "weft/scene/camera.hpp"
#include "weft/scene/environment_map.hpp"
#include "weft/scene/shape.hpp"

namespace weft {

struct DirectionalLight {
  Vector3 direction{0, 0, 1};                 // towards the light, of unit length
  std::array<double, 3> irradiance{1, 1, 1};  // on a plane perpendicular to it
};

// A light from (theta, phi) in degrees, measured from +z and from +x towards +y.
DirectionalLight light_at_degrees(double theta, double phi, std::array<double, 3> irradiance);

struct EnvironmentLight {
  std::shared_ptr<const EnvironmentMap> map;
  double rotation = 0;       // about the z axis, degrees, counter-clockwise as seen from above
  double scale = 1;          // of the radiance
  std::size_t samples = 64;  // per shading point
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
// length, and counts within [1, 65536].
void validate(const Scene& scene);

}  // namespace weft
