// Directions to light, drawn as a material reflects them: the importance sampling of V. Havran,
// J. Filip and K. Myszkowski, Bidirectional Texture Function Compression Based on Multi-Level
// Vector Quantization (Computer Graphics Forum 29, 2010), section 5.2.
//
// The slice of a view v and a texel x is what the material reflects of the light from every
// direction w, per unit of irradiance on a plane perpendicular to it: T(x, v, w) of a `radiance`,
// T(x, v, w) cos(theta) of a `brdf`, in linear light and never negative. Directions are drawn with
// a density p(w) per unit of solid angle that follows the slice's luminance, is above 0 on the
// whole hemisphere (that of the cosine where the slice is black), and integrates to 1 over it. The
// direction is a continuous function of the two numbers it is drawn with.
//
//   albedo(x, v)_c = integral of the slice's channel c over the hemisphere        (equation (6))
//
// Views lie anywhere; they are interpolated between the measured ones as look-ups do (Hemisphere).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "weft/btf/btf.hpp"

namespace weft {

struct LightQuery {
  std::array<float, 3> view{0, 0, 1};  // of any finite length above 0
  std::uint32_t texel = 0;             // y X + x
  bool operator==(const LightQuery&) const = default;
};

struct DrawnLight {
  std::array<float, 3> direction{0, 0, 1};  // towards the light, of unit length, z >= 0
  float density = 0;                        // p, per unit of solid angle
};

class LightSampler {
 public:
  virtual ~LightSampler() = default;

  // The light of each query that belongs to its two numbers in [0, 1). Queries of one slice that
  // follow each other cost less.
  virtual void sample(std::span<const LightQuery> queries,
                      std::span<const std::array<float, 2>> numbers, std::span<DrawnLight> out) = 0;
  // p of directions of unit length: 0 below the horizon.
  virtual void densities(std::span<const LightQuery> queries,
                         std::span<const std::array<float, 3>> lights, std::span<float> out) = 0;
  // [queries][C]
  virtual void albedos(std::span<const LightQuery> queries, std::span<float> out) = 0;
};

// Throw an input error that names the first query whose texel is out of range or whose view is no
// direction, or the first number out of [0, 1).
void validate_light_queries(const BtfShape& shape, std::span<const LightQuery> queries);
void validate_light_numbers(std::span<const std::array<float, 2>> numbers);

}  // namespace weft
