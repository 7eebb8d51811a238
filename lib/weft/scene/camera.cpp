#include "weft/scene/camera.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

constexpr std::size_t largest_side = 65536;
constexpr double widest_view = 170;
// The sine of the angle between `up` and the line of sight below which `up` tells no direction.
constexpr double least_sine = 1e-6;

void check_point(const Vector3& point, std::string_view field) {
  for (const double x : point) {
    if (!(std::abs(x) <= 1e6)) {
      fail_input("camera: {} ({}, {}, {}): each must be within -1e6 and 1e6", field, point[0],
                 point[1], point[2]);
    }
  }
}

}  // namespace

void validate(const Camera& camera) {
  check_point(camera.eye, "eye");
  check_point(camera.target, "target");
  check_point(camera.up, "up");
  if (length(difference(camera.target, camera.eye)) < 1e-6) {
    fail_input("camera: eye and target are the same point ({}, {}, {})", camera.eye[0],
               camera.eye[1], camera.eye[2]);
  }
  if (length(camera.up) < 1e-6) fail_input("camera: up has no length");
  if (!(camera.field_of_view > 0 && camera.field_of_view <= widest_view)) {
    fail_input("camera: field of view {}: must be above 0 and at most {} degrees",
               camera.field_of_view, widest_view);
  }
  if (camera.width < 1 || camera.height < 1 || camera.width > largest_side ||
      camera.height > largest_side || camera.width * camera.height > (std::size_t{1} << 31)) {
    fail_input(
        "camera: a picture of {} x {}: each side must be within 1 and {}, and all within 2^31",
        camera.width, camera.height, largest_side);
  }
}

Camera camera_at_degrees(double theta, double phi, double distance) {
  constexpr double degree = std::numbers::pi / 180;
  const double sine = std::sin(theta * degree);
  Camera camera;
  camera.eye = scaled(
      {sine * std::cos(phi * degree), sine * std::sin(phi * degree), std::cos(theta * degree)},
      distance);
  return camera;
}

CameraRays::CameraRays(const Camera& camera)
    : eye_(camera.eye),
      center_x_(static_cast<double>(camera.width) / 2),
      center_y_(static_cast<double>(camera.height) / 2) {
  validate(camera);
  forward_ = normalized(difference(camera.target, camera.eye));
  Vector3 right = cross(forward_, normalized(camera.up));
  if (length(right) < least_sine) right = cross(forward_, {0, 1, 0});
  if (length(right) < least_sine) right = cross(forward_, {0, 0, 1});
  right = normalized(right);
  const double half = std::tan(camera.field_of_view * std::numbers::pi / 360);
  const double pixel = half / std::min(center_x_, center_y_);
  right_ = scaled(right, pixel);
  down_ = scaled(cross(forward_, right), pixel);
}

Ray CameraRays::at(double x, double y) const {
  const Vector3 across = scaled(right_, x - center_x_);
  const Vector3 along = scaled(down_, y - center_y_);
  return {eye_, normalized(sum(forward_, sum(across, along)))};
}

double radical_inverse(std::size_t index) {
  double inverse = 0, place = 0.5;
  for (; index != 0; index >>= 1, place /= 2) inverse += place * static_cast<double>(index & 1);
  return inverse;
}

std::array<double, 2> pixel_sample(std::size_t index, std::size_t count) {
  return {(static_cast<double>(index) + 0.5) / static_cast<double>(count),
          radical_inverse(index) + 0.5 / static_cast<double>(std::bit_ceil(count))};
}

}  // namespace weft
