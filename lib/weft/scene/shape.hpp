// Shapes that wear a material: where a ray meets them, and which way the material lies there.
//
// Every shape fits the sphere of radius 1 round the origin, except for the plane's corners. Texture
// coordinates count tiles of the material: (u, v) = (0, 0) is a tile's lower left corner, v grows
// upwards.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>

#include "weft/scene/camera.hpp"
#include "weft/scene/reflectance.hpp"

namespace weft {

struct TriangleMesh;

struct SurfaceHit {
  double distance = 0;
  Vector3 position{};
  // Where rays towards lights start: the position; for meshes with smooth normals the point that
  // they suggest, so that a smooth body isn't shadowed by its own facets (Hanika, Hacking the
  // Shadow Terminator, Ray Tracing Gems II).
  Vector3 shadow_origin{};
  Vector3 geometric_normal{0, 0, 1};           // on the side that the ray comes from
  Vector3 normal{0, 0, 1};                     // for shading; on the side of the geometric one
  Vector3 along_u{1, 0, 0}, along_v{0, 1, 0};  // dp/du and dp/dv; zero where there is none
  std::array<double, 2> uv{};
};

class Shape {
 public:
  Shape() = default;
  virtual ~Shape() = default;
  Shape(const Shape&) = delete;
  Shape& operator=(const Shape&) = delete;

  // The first point that the ray meets. Safe to call from several threads.
  virtual std::optional<SurfaceHit> intersect(const Ray& ray) const = 0;

  // Whether the shape lies between a point of it and what is far away in that direction. `normal`
  // is the geometric one, on the side that is looked at.
  virtual bool occludes(const Vector3& point, const Vector3& normal,
                        const Vector3& direction) const = 0;

  // Bytes of host memory that it takes, where they are worth a plan.
  virtual std::size_t bytes() const { return 0; }
};

// How often the material is repeated along u and v.
using Repeat = std::array<double, 2>;

// Throws an input error unless both are within 0.001 and 10000.
void validate(const Repeat& repeat);

// The square [-1, 1]^2 at z = 0: u along +x, v along +y, seen from both sides.
std::shared_ptr<const Shape> make_plane(const Repeat& repeat);

// u runs round the z axis from the back (+y), with the front (-y) in the middle, v from the south
// pole to the north pole; `repeat` is for half the way round, pole to pole, and is made a whole
// number for u so that the seam at the back closes. Tangents are along the parallels; at a pole
// itself the parallel is taken to be +x.
std::shared_ptr<const Shape> make_sphere(const Repeat& repeat);

// A square cloth thrown over a ball: `repeat` tiles along its sides.
std::shared_ptr<const Shape> make_drape(const Repeat& repeat);

// A mesh with `repeat` tiles to a unit of its texture coordinates. Tangents are those of its
// triangles, made perpendicular to the interpolated normal.
std::shared_ptr<const Shape> make_mesh_shape(const TriangleMesh& mesh, const Repeat& repeat);

}  // namespace weft
