// Woven cloth as a periodic height field: two sets of arched, twisted yarns of elliptical section.
//
// Lengths are in spacings of the yarns. Warp yarn i runs along y at x = i + 1/2, weft yarn j along
// x at y = j + 1/2. Over the length s of a yarn its centre line rises by `crimp` where it lies on
// top and sinks by as much where it passes under, with a smooth step half-way between two
// crossings; a float, a run of crossings on top, bulges by `float_arch` more in its middle.
//
//   elevation(s, u) = centre(s) + thickness/2 sqrt(1 - u^2) + ply relief,   u = offset / (width/2)
//
//        weft ____   ____   ____ weft            section across the warp:
//            /    \ /    \ /    \                   .-~~-.      o warp yarns, cut
//        ___/  o   X  o   X  o   \___             (   o    )    ~ the upper half is seen
//
// The surface is the highest of all yarns and of a backing below them. Yarns differ a little from
// each other, and wander; all of it repeats with the tile.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "weft/scene/fields.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

// The interlacing: warp yarn i is on top of weft yarn j where (j + step i) mod (over + under) <
// over. Plain weave 1/1 step 1; twill 2/2 or 3/1 step 1; satin 4/1 step 2.
struct WeavePattern {
  std::size_t over = 2;
  std::size_t under = 2;
  std::size_t step = 1;

  std::size_t period() const { return over + under; }
  bool warp_on_top(std::size_t warp, std::size_t weft) const {
    return (weft + step * warp) % period() < over;
  }
};

// One set of yarns.
struct Yarn {
  std::array<float, 3> color{0.5f, 0.5f, 0.5f};  // diffuse albedo, linear light
  GlossyLobe gloss;
  double width = 1.0;        // of the section, in spacings
  double thickness = 0.44;   // of the section
  double crimp = 0.17;       // of the centre line, up and down
  double float_arch = 0.09;  // height of a float's middle above its ends, besides the crimp
  double pinch = 0.3;        // relative loss of width where crossing yarns press on it
  std::size_t plies = 3;     // twisted strands seen side by side; at least 1
  double twists = 0.55;      // plies that pass per spacing of length; negative twists the other way
  double ply_relief = 0.05;  // depth of the grooves between plies
  double fibre_relief = 0.014;  // height of single fibres
};

// By default a 2/2 twill of lustrous blue warp and matt ivory weft.
struct WeaveCloth {
  WeavePattern pattern;
  Yarn warp{.color = {0.035f, 0.085f, 0.26f},
            .gloss = {{0.055f, 0.06f, 0.075f}, 1.0f, 0.22f, 0.42f}};
  Yarn weft{.color = {0.62f, 0.53f, 0.38f},
            .gloss = {{0.035f, 0.035f, 0.035f}, 0.7f, 0.42f, 0.6f},
            .twists = -0.5};
  std::array<float, 3> backing{0.02f, 0.02f, 0.02f};  // albedo of what shows through gaps
  // Yarns of one tile; multiples of the pattern's period.
  std::size_t warp_count = 16;
  std::size_t weft_count = 16;
  double wander = 0.035;      // sideways, in spacings
  double color_spread = 0.1;  // relative, from yarn to yarn and along a yarn
  std::uint64_t seed = 1;     // of the irregularities
};

void describe(Fields& fields, WeaveCloth& cloth);

// Makes the tile longer by about these factors, as nearly as whole periods of the pattern allow.
void stretch(WeaveCloth& cloth, double along_x, double along_y);

// The default cloth, whose tile has 16 yarns along its shorter side, for images of width x height.
WeaveCloth standard_cloth(std::size_t width, std::size_t height);

// Samples of a surface along a side that `texels` texels share: a power of two, at least 8 per
// texel within 256 and 2048, so that the steps of edges are finer than what is seen.
std::size_t surface_resolution(std::size_t texels);

// Throws an input error that names the field and the value where the parameters make no cloth.
void validate(const WeaveCloth& cloth);

// The height field, with one lobe per set of yarns (0 warp, 1 weft) and one for the backing (2).
Surface make_surface(const WeaveCloth& cloth, std::size_t columns, std::size_t rows);

}  // namespace weft
