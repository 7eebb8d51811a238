// Renders a periodic height field, as woven cloth is one, into a BTF; in double, one sample at a
// time. The formula that the device follows:
//
//   T[v, l, row, column] = 1/S sum_s f(v, l) max(0, n.l) visible(hit_s, l)
//
// Sample s of a texel is a point (x, y) of the plane z = reference, at column + u_s and row + v_s,
// jittered in the texel's box; row 0 is the top edge. The view ray comes from outside, through that
// point, and meets the surface first at hit_s: it is marched downwards from the highest elevation
// in steps of at most one cell, and the last step is refined by bisection and one secant. The
// shadow ray is marched from the hit towards the light, one cell a step, until it is above the
// highest elevation. A flat Lambertian surface of albedo a gives a/pi cos(theta_l).
//
// Positions are in cells of the surface, x and y; elevations in its own units.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>

#include "weft/btf/directions.hpp"
#include "weft/btf/tile.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct SurfaceRenderOptions {
  std::size_t samples = 4;  // per texel, view and light; 1 to 65536
  std::uint64_t seed = 0;   // of the jitter
  // Bytes that the run of images in the making may take, at least one image and one texel's
  // samples.
  std::size_t tile_bytes = std::size_t{64} << 20;
  // Called with the number of images done so far.
  std::function<void(std::size_t)> progress;
};

// Least z of a direction: a ray nearer to the plane passes over a great many periods.
inline constexpr double least_direction_z = 0.01;

// Halvings of a step of the view ray, before the secant.
inline constexpr int view_bisections = 4;

// How a view's rays are marched. Point k of a ray is p + start + k step, k = 0..steps, where p is
// the point of the reference plane; point 0 has the highest elevation, the last one the lowest.
struct ViewMarch {
  double start_x = 0, start_y = 0, start_z = 0;
  double step_x = 0, step_y = 0, step_z = 0;
  std::size_t steps = 1;
};
ViewMarch march_of_view(const Surface& surface, const Direction& view);

// How shadow rays towards a light are marched: point k is p + k step, k = 1, 2, ...
struct LightMarch {
  double step_x = 0, step_y = 0, step_z = 0;
};
LightMarch march_of_light(const Surface& surface, const Direction& light);

// How far above its hit a shadow ray begins: what rounding and the last refinement may have missed.
double shadow_bias(const Surface& surface);

// Where in its texel a sample lies: both in [0, 1), multiples of 2^-24.
std::array<double, 2> sample_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample);
// The part of the hash that all texels of a view share.
std::uint32_t view_key(std::uint64_t seed, std::size_t view);

// One sample with what decided it.
struct TracedSample {
  std::array<double, 3> radiance{};
  // The least distance between ray and surface, in elevation, of all comparisons on the way: an
  // arithmetic whose elevations are nearer than this to the exact ones takes the same path.
  double margin = 0;
};
TracedSample trace_sample(const Surface& surface, const Direction& view, const Direction& light,
                          double x, double y);

// Throws an input error that names the field and the value unless `info` is what can be rendered: a
// grid of radiance in 3 channels, U8 with sRGB encoding or F16 or F32 linear, every direction at
// least least_direction_z above the plane; and the options are in range.
void validate(const Surface& surface, const BtfInfo& info, const SurfaceRenderOptions& options);

// Renders all images that sink.info() asks for, and finishes the sink.
void render_surface_reference(const Surface& surface, const SurfaceRenderOptions& options,
                              TileSink& sink);

}  // namespace weft
