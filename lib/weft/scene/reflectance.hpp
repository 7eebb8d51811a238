// How a point of a surface reflects light: Lambertian, plus one glossy lobe of anisotropic
// microfacets (GGX), as fibres have it that shine along and across in different ways.
//
//   f(v, l) = albedo / pi + F(v.h) D(h) V(v, l)         h = (v + l) / |v + l|
//   D(h)    = 1 / (pi a b ((h.t/a)^2 + (h.b/b)^2 + (h.n)^2)^2)
//   V(v, l) = 1/2 / ( n.l |(a v.t, b v.b, n.v)| + n.v |(a l.t, b l.b, n.l)| )
//   F(c)    = f0 + (f90 - f0) (1 - c)^5
//
// t is the direction of the fibres, b = n x t, a and b the roughnesses along and across. V is the
// height-correlated masking and shadowing of Smith, divided by 4 n.v n.l. f is reciprocal.
#pragma once

#include <array>

namespace weft {

struct GlossyLobe {
  std::array<float, 3> f0{};  // reflectance at normal incidence, linear light, [0, 1]
  float f90 = 0;  // reflectance at grazing incidence; 0 with f0 = 0 switches the lobe off
  float alpha_along = 0.5f;   // roughness along the fibres, (0, 1]
  float alpha_across = 0.5f;  // roughness across them, (0, 1]
};

using Vector3 = std::array<double, 3>;

double dot(const Vector3& a, const Vector3& b);
Vector3 cross(const Vector3& a, const Vector3& b);
Vector3 normalized(const Vector3& a);

// Directions at a point: unit normal n, and t and b = n x t perpendicular to it.
struct ShadingFrame {
  Vector3 normal{0, 0, 1}, along{1, 0, 0}, across{0, 1, 0};
};

// The frame whose `along` is as near to `fibre` as the normal allows. Both have unit length.
ShadingFrame make_frame(const Vector3& normal, const Vector3& fibre);

// f(view, light) n.l: the outgoing radiance under a directional light of unit irradiance on a plane
// perpendicular to it. Zero for a light behind the surface; no gloss for a view behind it, which
// interpolated normals can give.
Vector3 reflected(const ShadingFrame& frame, const std::array<float, 3>& albedo,
                  const GlossyLobe& lobe, const Vector3& view, const Vector3& light);

}  // namespace weft
