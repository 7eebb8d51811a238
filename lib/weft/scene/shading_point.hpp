// What a camera ray meets, and the light that arrives there: where the geometry of a scene ends and
// the look-ups of its material begin.
//
// A picture is rendered over batches of pixels. A batch has N shading points, each with the same
// number of light samples S; the light samples of point i are [i S, (i + 1) S). With T the outgoing
// radiance of the material per unit of irradiance on a plane perpendicular to the light (quantity
// `radiance`), and m its mask, 1 where it has none,
//
//   picture[pixel] = background[pixel]
//                  + sum over points i of the pixel of
//                      weight_i (m sum over s of T(uv_i, view_i, light_s) irradiance_s
//                                + (1 - m) behind_i)
//
// where background[pixel] has the weight of the rays that meet nothing in it already.
#pragma once

#include <array>
#include <cstdint>

namespace weft {

struct ShadingPoint {
  std::uint32_t pixel = 0;    // row * width + column of the picture
  float weight = 1;           // share of the pixel: 1 / samples per pixel
  std::array<float, 2> uv{};  // texture coordinates in tiles of the material, wrapped to [0, 1):
                              // u along +x (columns), v along +y (upwards: row 0 is at v = 1)
  // Width of the ray's share of the pixel in tiles of the material: the longer and the shorter axis
  // of the parallelogram it covers there.
  std::array<float, 2> footprint{};
  std::array<float, 3> position{};  // in the world, z up
  // The material's axes in the world, orthonormal: tangent = +x, bitangent = +y. Left-handed where
  // the texture coordinates are mirrored, or where a sheet is seen from behind.
  std::array<float, 3> tangent{1, 0, 0}, bitangent{0, 1, 0}, normal{0, 0, 1};
  std::array<float, 3> view{0, 0, 1};  // towards the eye, in (tangent, bitangent, normal); z > 0
  std::array<float, 3> behind{};       // radiance that is seen where the material has a hole
};

// Light from one direction.
struct LightSample {
  std::array<float, 3> direction{0, 0, 1};  // towards the light, in the point's frame
  // On a plane perpendicular to the direction, with visibility in it, and divided by the density of
  // the sampling: a sum over the samples of a point stands for the integral over its lights. Zero
  // for lights below the material's horizon, which need no look-up.
  std::array<float, 3> irradiance{};
};

}  // namespace weft
