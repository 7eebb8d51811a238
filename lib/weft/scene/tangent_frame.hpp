// Which way the material lies at a point of a shape.
#pragma once

#include "weft/scene/shape.hpp"

namespace weft {

// Unit vectors: x of the material, y of the material, and its normal.
struct TangentFrame {
  Vector3 tangent{1, 0, 0}, bitangent{0, 1, 0}, normal{0, 0, 1};

  // A direction of the world in this frame.
  Vector3 to_local(const Vector3& direction) const;
  // A direction of this frame in the world.
  Vector3 to_world(const Vector3& direction) const;
};

// The frame of a hit that is seen from direction `to_eye`. The tangent is dp/du, made perpendicular
// to the normal; the bitangent is perpendicular to both, on the side of dp/dv. Without dp/du the
// bitangent is dp/dv; without both, the tangent is as near to +x as the normal allows, or to +y
// where that is along it.
//
// Interpolated normals may turn away from the eye at a silhouette; such a normal is bent towards
// the eye until it is seen at 88.9 degrees, so that no point is black for want of a view.
TangentFrame tangent_frame(const SurfaceHit& hit, const Vector3& to_eye);

}  // namespace weft
