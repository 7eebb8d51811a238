// A surface to render: one period of stacked layers of material with what is needed to shade them.
// Makers of geometry (woven cloth, ...) fill it, renderers read it; neither knows the other.
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
//
// A layer is solid from its elevation down, or one sheet of material between its elevation and its
// underside. A net is one sheet; a knit, whose yarns pass over each other, is two or more.
//
//        z ^   .-~~-.        .-~~-.   elevation     where elevation >= underside: material
//          |  (######)      (######)
//          |   '-..-'   \__/ '-..-'   underside     elsewhere: a hole
//          +-----------------------------> x
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "weft/scene/reflectance.hpp"

namespace weft {

// What to shade at a sample of the surface.
struct SurfaceSample {
  float normal_x = 0, normal_y = 0;  // of the top's unit normal; z is positive
  float fibre_x = 1, fibre_y = 0;    // direction of the fibres, seen from above
};

struct SurfaceColor {
  std::array<float, 3> albedo{};  // diffuse, linear light
  float lobe = 0;                 // index of the glossy lobe: a whole number, never interpolated
};

struct SurfaceLayer {
  std::vector<float> elevation;  // rows x columns: the top of the material
  // rows x columns: where the material ends below; empty where it is solid all the way down. A
  // column whose elevation is below its underside holds no material. Its two values still shape the
  // outline of the hole, which runs where the interpolated ones cross: they should go on as they
  // do beside it.
  std::vector<float> underside;
  // rows x columns: of the top. The underside has the fibres and colours of the top above it, and
  // the normals of its own slopes.
  std::vector<SurfaceSample> samples;
  std::vector<SurfaceColor> colors;
};

struct Surface {
  std::size_t columns = 0, rows = 0;
  double width = 0, depth = 0;
  std::vector<SurfaceLayer> layers;  // 1 to most_layers, in any order
  std::vector<GlossyLobe> lobes;

  // The elevation that texels lie at: the view ray of a texel passes through its point there.
  float reference = 0;
  // Bounds of the material. A ray that passes below `lowest` has left through a hole.
  float lowest = 0, highest = 0;
};

inline constexpr std::size_t most_layers = 8;

// A surface of `columns` x `rows` samples with `layers` solid ones, all zero and level, and one
// lobe that reflects nothing.
Surface make_flat_surface(std::size_t columns, std::size_t rows, double width, double depth,
                          std::size_t layers = 1);

// Fills in what follows from elevations and undersides: the bounds, as reference the mean of the
// highest material over the columns that hold any, and the normals by central differences. Throws
// an input error where no column holds material.
void finish_surface(Surface& surface);

// Whether a ray may pass through: no layer is solid.
bool may_have_holes(const Surface& surface);

// Throws an input error that names the field and the value unless the sizes are powers of two from
// 1 to 8192, the tables have these sizes, everything is finite, the bounds hold, albedos are in [0,
// 1] and lobes exist and are valid. In holes, elevation and underside may pass the bounds by as
// much as these are apart.
void validate(const Surface& surface);

}  // namespace weft
