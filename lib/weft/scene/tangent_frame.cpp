#include "weft/scene/tangent_frame.hpp"

#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// The least cosine that a normal is seen at.
constexpr double least_cosine = 0.02;
// Derivatives shorter than this relative to each other, or in all, tell no direction.
constexpr double least_ratio = 1e-6, least_length = 1e-12;

// The part of `a` that is perpendicular to the unit vector `normal`.
Vector3 perpendicular(const Vector3& a, const Vector3& normal) {
  return difference(a, scaled(normal, dot(a, normal)));
}

}  // namespace

Vector3 TangentFrame::to_local(const Vector3& direction) const {
  return {dot(direction, tangent), dot(direction, bitangent), dot(direction, normal)};
}

Vector3 TangentFrame::to_world(const Vector3& direction) const {
  return sum(scaled(tangent, direction[0]),
             sum(scaled(bitangent, direction[1]), scaled(normal, direction[2])));
}

TangentFrame tangent_frame(const SurfaceHit& hit, const Vector3& to_eye) {
  TangentFrame frame;
  frame.normal = hit.normal;
  const double cosine = dot(frame.normal, to_eye);
  if (cosine < least_cosine) {
    frame.normal =
        normalized(sum(perpendicular(frame.normal, to_eye), scaled(to_eye, least_cosine)));
  }
  const Vector3 along_u = perpendicular(hit.along_u, frame.normal);
  const Vector3 along_v = perpendicular(hit.along_v, frame.normal);
  const double length_u = length(along_u), length_v = length(along_v);
  const bool has_u = length_u > least_length && length_u > least_ratio * length_v;
  const bool has_v = length_v > least_length && length_v > least_ratio * length_u;
  if (has_u) {
    frame.tangent = normalized(along_u);
  } else if (has_v) {
    frame.tangent = normalized(cross(along_v, frame.normal));
  } else {
    const Vector3 x = perpendicular({1, 0, 0}, frame.normal);
    frame.tangent =
        length(x) > 0.1 ? normalized(x) : normalized(perpendicular({0, 1, 0}, frame.normal));
  }
  frame.bitangent = cross(frame.normal, frame.tangent);
  if (has_v && dot(frame.bitangent, along_v) < 0) frame.bitangent = scaled(frame.bitangent, -1);
  return frame;
}

}  // namespace weft
