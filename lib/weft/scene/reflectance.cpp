#include "weft/scene/reflectance.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace weft {
namespace {

// Shortest perpendicular part of a fibre direction that still is divided by its length.
constexpr double least_length = 1e-4;

// |(a v.t, b v.b, n.v)|
double projected_length(const ShadingFrame& frame, const GlossyLobe& lobe, const Vector3& d) {
  const double x = lobe.alpha_along * dot(d, frame.along);
  const double y = lobe.alpha_across * dot(d, frame.across);
  const double z = dot(d, frame.normal);
  return std::sqrt(x * x + y * y + z * z);
}

}  // namespace

double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector3 normalized(const Vector3& a) {
  const double length = std::sqrt(dot(a, a));
  return {a[0] / length, a[1] / length, a[2] / length};
}

ShadingFrame make_frame(const Vector3& normal, const Vector3& fibre) {
  const double lean = dot(normal, fibre);
  Vector3 along;
  for (std::size_t i = 0; i < 3; ++i) along[i] = fibre[i] - lean * normal[i];
  const double length = std::max(std::sqrt(dot(along, along)), least_length);
  for (double& component : along) component /= length;
  return {normal, along, cross(normal, along)};
}

Vector3 reflected(const ShadingFrame& frame, const std::array<float, 3>& albedo,
                  const GlossyLobe& lobe, const Vector3& view, const Vector3& light) {
  const double nl = dot(frame.normal, light);
  const double nv = dot(frame.normal, view);
  if (nl <= 0) return {};
  Vector3 radiance;
  for (std::size_t i = 0; i < 3; ++i) radiance[i] = albedo[i] * std::numbers::inv_pi * nl;
  if (nv <= 0) return radiance;

  const Vector3 h = normalized({view[0] + light[0], view[1] + light[1], view[2] + light[2]});
  const double a = lobe.alpha_along, b = lobe.alpha_across;
  const double ht = dot(h, frame.along) / a;
  const double hb = dot(h, frame.across) / b;
  const double hn = dot(h, frame.normal);
  const double s = ht * ht + hb * hb + hn * hn;
  const double distribution = std::numbers::inv_pi / (a * b * s * s);
  const double visibility =
      0.5 / (nl * projected_length(frame, lobe, view) + nv * projected_length(frame, lobe, light));
  const double grazing = std::pow(std::max(0.0, 1 - dot(view, h)), 5);
  for (std::size_t i = 0; i < 3; ++i) {
    const double fresnel = lobe.f0[i] + (lobe.f90 - lobe.f0[i]) * grazing;
    radiance[i] += fresnel * distribution * visibility * nl;
  }
  return radiance;
}

}  // namespace weft
