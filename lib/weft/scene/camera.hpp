// A perspective camera. The world has z up, as directions have it: theta is measured from +z, phi
// from +x towards +y.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "weft/scene/reflectance.hpp"

namespace weft {

struct Ray {
  Vector3 origin{};
  Vector3 direction{0, 0, 1};  // of unit length
};

struct Camera {
  Vector3 eye{0, -4, 1.6};
  Vector3 target{0, 0, 0};
  Vector3 up{0, 0, 1};        // where it is along the line of sight, +y stands in for it
  double field_of_view = 35;  // of the shorter side of the picture, degrees, in (0, 170]
  std::size_t width = 512;    // of the picture, in pixels
  std::size_t height = 512;
};

// Throws an input error that names the field and the value.
void validate(const Camera& camera);

// A camera that looks at the origin from `distance`, from direction (theta, phi) in degrees.
Camera camera_at_degrees(double theta, double phi, double distance);

// The rays of a camera: pixel (0, 0) is the top left one, its centre at (0.5, 0.5).
class CameraRays {
 public:
  explicit CameraRays(const Camera& camera);

  Ray at(double x, double y) const;

 private:
  Vector3 eye_, forward_, right_, down_;  // right_ and down_ span one pixel at distance 1
  double center_x_, center_y_;
};

// The bits of the index behind the point, in reverse: in [0, 1), ever finer and evenly spread.
double radical_inverse(std::size_t index);

// Sample `index` of `count` in the unit square: the Hammersley points, moved so that one sample is
// the centre. The same for every pixel, so that pictures of two materials compare.
std::array<double, 2> pixel_sample(std::size_t index, std::size_t count);

}  // namespace weft
