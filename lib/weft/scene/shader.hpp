// What shading points reflect: the interface between the geometry of a scene and its material.
//
// At point i, with m its mask (1 where the material has none), a its opacity (m, unless it is found
// from numbers O, see Opacity) and T the material in linear light,
//
//   radiance[i] = (sum over its light samples s of T(uv, view, light_s) irradiance_s a / m,  a)
//
// T is looked up barycentrically in both directions (Hemisphere), bilinearly in the texels of two
// mip levels (texture_taps.hpp), in the stored encoding; decoded to linear light; clipped at 0; and
// taken times cos(theta_l) for a `brdf`, or times DirectionWeights::scale for `radiance`. Levels
// are mixed in linear light. In those levels that are a model's own, one that is a function of all
// directions (Model::takes_directions) is looked up at the view and the light themselves, and one
// with a grid of views (Model::view_grid) at the grid's nearest entry. Where the mask has an edge,
// m is interpolated like the values, which are 0 in the hole: so the values are premultiplied by m.
// They are divided by m before they are decoded and multiplied by the opacity after, so that no
// dark fringe is left.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/model/occlusion.hpp"
#include "weft/scene/shading_point.hpp"

namespace weft {

class LightTables;

// Linear rgb, premultiplied by the opacity, and the opacity.
using PointRadiance = std::array<float, 4>;

class Shader {
 public:
  virtual ~Shader() = default;

  // lights: [points][S] for any S; radiance: [points]. What a point gets depends on nothing but the
  // point and its lights, bit by bit. Adds the time of its stages to the job: "directions",
  // "look-ups" and "shading".
  virtual void shade(std::span<const ShadingPoint> points, std::span<const LightSample> lights,
                     std::span<PointRadiance> radiance, Job& job) = 0;

  // What lights are drawn from at points of this material (light_tables.hpp), in at most about
  // `memory` bytes. Adds the stage "light tables".
  virtual LightTables light_tables(std::size_t memory, Job& job) = 0;

  // Points and light samples that it takes at once: batches of about as many cost least.
  virtual std::size_t batch_samples() const = 0;

  // Bytes of device and host memory that it takes, with a batch in hand.
  virtual std::size_t bytes() const = 0;
};

// Throws an input error that names the field unless a material can be shaded: a grid of 1 (grey) or
// 3 channels. A `paired` BTF has no light for every view.
void validate_material(const BtfInfo& info);

// Numbers O from which eq. (26) of K-CTA makes opacities: signed distances, or what the model of a
// mask decodes to. In the finest level they are interpolated before they are mapped, which leaves
// an outline sharp however large it is seen; coarser levels average opacities.
struct Opacity {
  VisibilityMapping mapping;
  std::vector<float> values;  // [V][Y][X]
};

// What masks and opacities are looked up in, as images [V][1][Y][X]: of the finest level and of the
// one that coarser levels are made of. One channel, U8, 255 where the view meets material; with
// opacities two, F32: m and O in the finest level, m and the opacity in the others. Both null
// without a mask.
struct MaskSources {
  std::shared_ptr<TileSource> finest;
  std::shared_ptr<TileSource> coarser;  // as large as the finest
};
MaskSources mask_sources(const BtfInfo& info, const Opacity* opacity);

// The levels of a material of `shape`: level 0 and those of last_mip_level().
std::size_t mip_levels(const BtfShape& shape);

// The next mip level of a source: 2 x 2 texels averaged in linear light, and stored as they are.
std::shared_ptr<TileSource> next_mip_level(std::shared_ptr<TileSource> source);

// picture[pixel] += weight (radiance + (1 - a) behind), and the fourth value += weight a. Pixels
// count from `first_pixel`; picture: [pixels][4].
void add_points(std::span<const ShadingPoint> points, std::span<const PointRadiance> radiance,
                std::size_t first_pixel, std::span<std::array<float, 4>> picture);

}  // namespace weft
