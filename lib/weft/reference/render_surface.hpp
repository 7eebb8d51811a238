// Renders a surface of layers (weft/scene/surface.hpp) into a BTF; in double, one sample at a time.
// The formula that the device follows:
//
//   T[v, l, row, column] = 1/S sum_s f(v, l) max(0, n.l) visible(hit_s, l)
//
// Sample s of a texel is a point (x, y) of the plane z = reference, at column + u_s and row + v_s,
// jittered in the texel's box; row 0 is the top edge. The view ray comes from outside, through that
// point, and meets the surface first at hit_s: it is marched downwards from the highest elevation
// in steps of at most one cell, and the last step is refined by bisection and one secant. The
// shadow ray is marched from the hit towards the light, one cell a step, until it is above the
// highest elevation. A view ray that leaves through a hole adds 0. A flat Lambertian surface of
// albedo a gives a/pi cos(theta_l).
//
// With one bounce, light that reaches the hit by way of one more point of the surface is added, as
// far as both reflect it diffusely; gloss is left out of it at either point:
//
//   + 1/S sum_s albedo albedo'/pi max(0, n'.l) visible(hit'_s, l)
//
// hit'_s is what a ray meets that leaves hit_s in a direction drawn with density cos/pi round its
// normal; it adds nothing if it meets nothing, or a face from behind. So every value is at most the
// direct one plus 1/pi.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>

#include "weft/btf/directions.hpp"
#include "weft/btf/tile.hpp"
#include "weft/reference/surface_march.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

struct SurfaceRenderOptions {
  std::size_t samples = 4;  // per texel, view and light; 1 to 65536
  std::uint64_t seed = 0;   // of the jitter
  std::size_t bounces = 0;  // between points of the surface: 0 or 1
  // Bytes that the run of images in the making may take, at least one image and one texel's
  // samples.
  std::size_t tile_bytes = std::size_t{64} << 20;
  // Called with the number of images done so far.
  std::function<void(std::size_t)> progress;
};

// Least z of a direction: a ray nearer to the plane passes over a great many periods.
inline constexpr double least_direction_z = 0.01;

// Where in its texel a sample lies: both in [0, 1), multiples of 2^-24.
std::array<double, 2> sample_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample);
// The part of the hash that all texels of a view share.
std::uint32_t view_key(std::uint64_t seed, std::size_t view);

// Direction in which the ray of the bounce leaves a sample's hit: a point of the unit square.
std::array<double, 2> bounce_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample);

// One sample with what decided it.
struct TracedSample {
  std::array<double, 3> radiance{};
  bool met = false;  // material
  // See widest_margin.
  double margin = widest_margin;
};
// (x, y): its point of the reference plane. `bounce`: as of bounce_offset, for one bounce.
TracedSample trace_sample(const Surface& surface, const Direction& view, const Direction& light,
                          double x, double y,
                          const std::optional<std::array<double, 2>>& bounce = {});

// Throws an input error that names the field and the value unless `info` is what can be rendered: a
// grid of radiance in 3 channels, U8 with sRGB encoding or F16 or F32 linear, every direction at
// least least_direction_z above the plane; and the options are in range.
void validate(const Surface& surface, const BtfInfo& info, const SurfaceRenderOptions& options);

// Fills info.mask and info.mask_distance of a surface that may have holes; of others, empties them.
// A texel is material where at least half of mask_parts x mask_parts view rays meet it, one
// jittered in each of its parts.
inline constexpr std::size_t mask_parts = 4;
void render_surface_mask_reference(const Surface& surface, const SurfaceRenderOptions& options,
                                   BtfInfo& info);

// Renders all images that sink.info() asks for, and finishes the sink.
void render_surface_reference(const Surface& surface, const SurfaceRenderOptions& options,
                              TileSink& sink);

}  // namespace weft
