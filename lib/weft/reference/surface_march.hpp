// How a ray meets a surface of layers; in double, point by point. The rules that the device
// follows:
//
// Point k of a ray is p + k step, k = 0, 1, 2, ..., at most a cell apart in x and in y. There, for
// layer l,
//   above = z - elevation_l,   below = underside_l - z   (negative where the layer is solid),
// and the ray is inside where both are negative. From point to point both are taken to be linear: a
// ray that has passed a sheet between two points met it if it was inside on the way.
//
// Positions are in cells of the surface, x and y; elevations in its own units.
#pragma once

#include <array>
#include <cstddef>
#include <limits>

#include "weft/btf/directions.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

// Halvings of a step of a ray, before the chord.
inline constexpr int ray_bisections = 4;

// How a view's rays are marched. Point k of a ray is p + start + k step, k = 0..steps, where p is
// the point of the reference plane; point 0 has the highest elevation, the last one the lowest.
struct ViewMarch {
  double start_x = 0, start_y = 0, start_z = 0;
  double step_x = 0, step_y = 0, step_z = 0;
  std::size_t steps = 1;
};
ViewMarch march_of_view(const Surface& surface, const Direction& view);

// A step in a direction, as far as a cell in x or in y, and no farther than passes over everything
// there is. Point k of a shadow ray is p + k step, k = 1, 2, ...
struct StepMarch {
  double step_x = 0, step_y = 0, step_z = 0;
};
StepMarch march_along(const Surface& surface, const Vector3& direction);

// How far outside its face a ray that leaves a point begins: what rounding and the last refinement
// may have missed.
double shadow_bias(const Surface& surface);

// The most steps of a ray that leaves a point in any direction but a light's. One that has met
// nothing by then runs level over more than a period; it is taken to have left.
std::size_t bounce_reach(const Surface& surface);

// A bilinear look-up: four samples and their weights.
struct SurfacePatch {
  std::array<std::size_t, 4> index;
  std::array<double, 4> weight;
};
SurfacePatch patch_at(const Surface& surface, double x, double y);

// A table [rows][columns] at a point.
double height_at(const Surface& surface, const std::vector<float>& table, double x, double y);

// A point of the surface.
struct SurfaceHit {
  double x = 0, y = 0, z = 0;
  bool met = false;
  bool under = false;     // of the underside of its layer
  std::size_t layer = 0;  // of the surface
};

// What `margin` of the functions below is made smaller to: the least distance, in elevation, by
// which a comparison on the way was decided. An arithmetic whose elevations are nearer than this to
// the exact ones takes the same path.
inline constexpr double widest_margin = std::numeric_limits<double>::infinity();

// The first meeting of a view ray with the surface. (x, y): its point of the reference plane.
SurfaceHit trace_view(const Surface& surface, const ViewMarch& march, double x, double y,
                      double& margin);

// What a ray meets that leaves a hit in a direction.
SurfaceHit trace_from(const Surface& surface, const SurfaceHit& hit, const Vector3& direction,
                      double& margin);

// Whether a light whose rays are marched so reaches a hit.
bool is_lit(const Surface& surface, const StepMarch& march, const SurfaceHit& hit, double& margin);

}  // namespace weft
