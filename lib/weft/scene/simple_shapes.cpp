// The plane and the sphere, in double.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/shape.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

using std::numbers::pi;

// Parallels shorter than this are taken to have this radius, so that even a pole has a tangent.
constexpr double least_parallel = 1e-9;

class Plane : public Shape {
 public:
  explicit Plane(const Repeat& repeat) : repeat_(repeat) {}

  std::optional<SurfaceHit> intersect(const Ray& ray) const override {
    if (ray.direction[2] == 0) return std::nullopt;
    const double distance = -ray.origin[2] / ray.direction[2];
    if (!(distance > 0)) return std::nullopt;
    const double x = ray.origin[0] + distance * ray.direction[0];
    const double y = ray.origin[1] + distance * ray.direction[1];
    if (std::abs(x) > 1 || std::abs(y) > 1) return std::nullopt;
    SurfaceHit hit;
    hit.distance = distance;
    hit.position = hit.shadow_origin = {x, y, 0};
    hit.normal = hit.geometric_normal = {0, 0, ray.direction[2] < 0 ? 1.0 : -1.0};
    hit.along_u = {2 / repeat_[0], 0, 0};
    hit.along_v = {0, 2 / repeat_[1], 0};
    hit.uv = {(x + 1) / 2 * repeat_[0], (y + 1) / 2 * repeat_[1]};
    return hit;
  }

  bool occludes(const Vector3& /*point*/, const Vector3& normal,
                const Vector3& direction) const override {
    return dot(normal, direction) <= 0;
  }

 private:
  Repeat repeat_;
};

class Sphere : public Shape {
 public:
  explicit Sphere(const Repeat& repeat)
      : tiles_round_(std::max(1.0, std::round(2 * repeat[0]))), tiles_up_(repeat[1]) {}

  std::optional<SurfaceHit> intersect(const Ray& ray) const override {
    // The point of the ray nearest to the centre, and from there half the chord back.
    const double nearest = -dot(ray.origin, ray.direction);
    const Vector3 closest = sum(ray.origin, scaled(ray.direction, nearest));
    const double square = 1 - dot(closest, closest);
    if (square < 0) return std::nullopt;
    const double half = std::sqrt(square);
    double distance = nearest - half;
    const bool inside = distance <= 0;
    if (inside) distance = nearest + half;
    if (!(distance > 0)) return std::nullopt;

    SurfaceHit hit;
    hit.distance = distance;
    const Vector3 out = normalized(sum(ray.origin, scaled(ray.direction, distance)));
    hit.position = hit.shadow_origin = out;
    hit.normal = hit.geometric_normal = inside ? scaled(out, -1) : out;
    const double radius = std::hypot(out[0], out[1]);
    const double sine = radius > 0 ? out[0] / radius : 0;
    const double cosine = radius > 0 ? -out[1] / radius : 1;
    hit.uv = {(std::atan2(sine, cosine) / (2 * pi) + 0.5) * tiles_round_,
              (std::atan2(out[2], radius) / pi + 0.5) * tiles_up_};
    hit.along_u =
        scaled({cosine, sine, 0}, 2 * pi * std::max(radius, least_parallel) / tiles_round_);
    hit.along_v = scaled({-out[2] * sine, out[2] * cosine, radius}, pi / tiles_up_);
    return hit;
  }

  bool occludes(const Vector3& /*point*/, const Vector3& normal,
                const Vector3& direction) const override {
    return dot(normal, direction) <= 0;
  }

 private:
  double tiles_round_, tiles_up_;
};

}  // namespace

void validate(const Repeat& repeat) {
  for (const double tiles : repeat) {
    if (!(tiles >= 1e-3 && tiles <= 1e4)) {
      fail_input("repeat {} x {}: each must be within 0.001 and 10000 tiles", repeat[0], repeat[1]);
    }
  }
}

std::shared_ptr<const Shape> make_plane(const Repeat& repeat) {
  validate(repeat);
  return std::make_shared<Plane>(repeat);
}

std::shared_ptr<const Shape> make_sphere(const Repeat& repeat) {
  validate(repeat);
  return std::make_shared<Sphere>(repeat);
}

}  // namespace weft
