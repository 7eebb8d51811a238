// A surface to render: one period of a height field with what is needed to shade it. Makers of
// geometry (woven cloth, ...) fill it, renderers read it; neither knows the other.
//
// The period is a rectangle of `width` x `depth` in the units of the elevation, cut into
// columns x rows cells. Sample (r, c) lies at x = c width / columns, y = r depth / rows: y runs up,
// as directions have it, so that row 0 of the samples is the *bottom* edge of the texture.
//
//        y ^  r = rows-1  . . . . . .
//          |              . . . . . .      index r columns + c
//          |  r = 0       . . . . . .
//          +-----------------------------> x
//                         c = 0    c = columns-1
//
// Between samples everything is bilinear, and everything repeats, in both directions. The sizes are
// powers of two, so that a ray wraps with one mask.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "weft/scene/reflectance.hpp"

namespace weft {

// What to shade at a sample of the surface.
struct SurfaceSample {
  float normal_x = 0, normal_y = 0;  // of the unit normal; z is positive
  float fibre_x = 1, fibre_y = 0;    // direction of the fibres, seen from above
};

struct SurfaceColor {
  std::array<float, 3> albedo{};  // diffuse, linear light
  float lobe = 0;                 // index of the glossy lobe: a whole number, never interpolated
};

struct Surface {
  std::size_t columns = 0, rows = 0;
  double width = 0, depth = 0;
  std::vector<float> elevation;        // rows x columns
  std::vector<SurfaceSample> samples;  // rows x columns
  std::vector<SurfaceColor> colors;    // rows x columns
  std::vector<GlossyLobe> lobes;

  // The elevation that texels lie at: the view ray of a texel passes through its point there.
  float reference = 0;
  // Bounds of the elevation.
  float lowest = 0, highest = 0;
};

// A surface of `columns` x `rows` samples, all zero and level, with one lobe that reflects nothing.
Surface make_flat_surface(std::size_t columns, std::size_t rows, double width, double depth);

// Fills in what follows from the elevation: its bounds, its mean as reference, and the normals by
// central differences.
void finish_surface(Surface& surface);

// Throws an input error that names the field and the value unless the sizes are powers of two from
// 1 to 8192, the tables have these sizes, everything is finite, the bounds hold, albedos are in [0,
// 1] and lobes exist and are valid.
void validate(const Surface& surface);

}  // namespace weft
