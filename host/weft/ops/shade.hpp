// The steps of shading on a device: kernels/weigh_directions.cl, shade_points.cl.
#pragma once

#include <cstddef>
#include <cstdint>

#include "weft/btf/btf.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/btf/lookup.hpp"
#include "weft/device/device.hpp"
#include "weft/model/occlusion.hpp"

namespace weft::ops {

// A triangulated hemisphere in device memory.
class DeviceHemisphere {
 public:
  DeviceHemisphere(Device& device, const Hemisphere& hemisphere);

  // out: [count][8] words: three indices, three weights, scale and cosine, of the directions
  // [count][4].
  void weigh(Device& device, std::size_t count, const Buffer& directions, Buffer& out) const;

  std::size_t bytes() const;

 private:
  std::size_t triangle_count_ = 0;
  std::size_t edge_count_ = 0;
  std::size_t side_ = 0;
  Buffer measured_, triangles_, triangle_rows_, edges_, edge_rows_, grid_;
};

inline constexpr std::size_t direction_words = 8;
inline constexpr std::size_t texel_tap_words = 8;

// Points and the light samples that reach them, as shade_points.cl lays them out.
struct ShadeTables {
  Buffer taps;                               // [points][2][8] words
  Buffer view_directions, light_directions;  // [points][4], [samples][4] floats
  Buffer share;                              // [points][2] floats
  Buffer masks;       // [points][2] pairs of floats, m and the opacity: 1 where there is no mask
  Buffer views;       // [points][8] words
  Buffer grid_views;  // [points] uint, where a level has a grid of views
  Buffer first;       // [points + 1] uint
  Buffer point_of;    // [samples] uint
  Buffer lights;      // [samples][8] words
  Buffer irradiance;  // [samples][4] floats
  Buffer light;       // [samples][2][4] floats
};

// Which look-ups a level is shaded by: between measured directions; in the views of a grid; or of
// directions themselves.
enum class ShadeLookups : std::uint8_t { measured, grid, directions };
LookupShape lookup_shape(ShadeLookups lookups);

// Records for `count` entries of `list`; and those of LookupShape{4, 3, 1} of the mask.
void write_lookups(Device& device, std::size_t count, const Buffer& list, const ShadeTables& tables,
                   ShadeLookups kind, Buffer& lookups);
void write_mask_lookups(Device& device, std::size_t count, const Buffer& list,
                        const ShadeTables& tables, Buffer& lookups);
// Takes the values that were looked up, of the mask, or of a material that `info` describes.
void set_masks(Device& device, std::size_t count, const Buffer& list, const Buffer& values,
               ShadeTables& tables);
// Of pairs of values: m and the opacity, or, with a mapping, m and what it maps.
void set_opacities(Device& device, std::size_t count, const Buffer& list, const Buffer& values,
                   const VisibilityMapping* mapping, ShadeTables& tables);
void light_entries(Device& device, const BtfInfo& info, ShadeLookups kind, std::size_t count,
                   const Buffer& list, const Buffer& values, ShadeTables& tables);
// radiance: [points][4] floats
void sum_points(Device& device, std::size_t points, const ShadeTables& tables, Buffer& radiance);

}  // namespace weft::ops
