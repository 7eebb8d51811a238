// What a fit shall care for: weights of a BTF's values, positive and separable,
//
//   w[v, l, p] = views[v] lights[l] texels[p]        p = y X + x
//
// A fit minimises sum w (T - T')^2. That is a plain fit of s T with s = sqrt(w), whose factors are
// divided by s.
#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/selection.hpp"

namespace weft {

// Bounds of positive weights: their roots leave float's range to the values.
inline constexpr double least_weight = 1e-9;
inline constexpr double most_weight = 1e9;

// An empty list is all 1.
struct Weights {
  std::vector<double> views;   // [V]
  std::vector<double> lights;  // [L]
  std::vector<double> texels;  // [P]

  bool all_equal() const { return views.empty() && lights.empty() && texels.empty(); }
  // Of an image, i = v L + l.
  double image(std::size_t i, std::size_t light_count) const {
    return (views.empty() ? 1.0 : views[i / light_count]) *
           (lights.empty() ? 1.0 : lights[i % light_count]);
  }
  double texel(std::size_t p) const { return texels.empty() ? 1.0 : texels[p]; }
};

// Weights by which the squared error of a BTF is that of pictures of it: a patch of the surface is
// seen on as many pixels as its area projected to the view direction, w_v = cos theta_v, and an
// error of its radiance is an error of the picture. Radiance has the light's cosine in it; a BRDF f
// makes the radiance f cos theta_l, so that w_l = cos^2 theta_l there (as Ngan, Durand & Matusik
// 2005 weigh the errors of BRDF models). Directions at 90 degrees or beyond have weight zero.
Weights cosine_weights(const BtfInfo& info);

// The product of two.
Weights operator*(const Weights& a, const Weights& b);

// Takes what has weight zero out of a selection of the BTF that the weights are of: views, lights,
// and the texels round a rectangle. Throws an input error that names the mode where nothing is
// left, and the texel where those of weight zero do not leave a rectangle.
Selection without_zeros(const Weights& weights, const BtfInfo& info, const Selection& selection);

// The weights of a selection of the BTF that they are of, each mode's scaled to the mean 1; equal
// ones become empty. Of a mip level, the averages of its texels.
Weights select(const Weights& weights, const BtfInfo& info, const Selection& selection);

// s = sqrt(w).
Weights square_roots(const Weights& weights);

// Weights of rows and of columns whose products are those of the texels, or nothing where there are
// none to within a part in a million.
using RowsAndColumns = std::pair<std::vector<double>, std::vector<double>>;
std::optional<RowsAndColumns> rows_and_columns(const std::vector<double>& texels,
                                               std::size_t height, std::size_t width);

}  // namespace weft
