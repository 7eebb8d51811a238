// What a BTF is in other directions, as matrices that depend on directions alone (Havran et al.,
// section 4.1): first the lights of every measured view are interpolated, then the views.
//
//   G[f, l', .]  = sum_l A_f[l', l] T[v_f, l, .]                frames f = 0 .. F - 1
//   T'[v', l', .] = max(sum_f B[v', f] G[f, l', .], 0)          8-bit data: at most 1, too
//
// A frame is a measured view with a turn of the lights. In the directions of a grid all frames
// share one matrix A and B is V' x V. In onion slices the lights of a view are turned with its
// azimuth, so that the highlights of different views lie in one place when the views are mixed; the
// zenith view, which has no azimuth, has a frame for each of the n_phi turns. Where no view was
// measured at the zenith it is first made of all others in the surface's frame: else its turns
// would disagree.
//
// Where a value contains the cosine of the light (`radiance`), a row of A is multiplied with
// cos(theta) / cos(theta, clamped) for lights outside the hull of the measured ones; with the
// encoded factor for encoded values, which is the same for gamma2.2 and nearly so for sRGB.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/btf/onion_slices.hpp"

namespace weft {

struct Resampling {
  struct Frame {
    std::size_t view = 0;    // v_f; V: the zenith view that is made
    std::size_t lights = 0;  // number of its matrix A_f
  };

  BtfInfo info;                // of T', F32, without masks; of onion slices in layout `paired`
  std::size_t new_views = 0;   // V'
  std::size_t new_lights = 0;  // L'
  std::size_t measured_views = 0, measured_lights = 0;
  std::vector<Frame> frames;
  std::vector<double> lights;  // A [matrices][L'][L]
  std::vector<double> views;   // B [V'][F]
  std::vector<double> zenith;  // weights of the measured views for the one that is made, or empty
  std::vector<std::size_t> nearest;  // measured view next to each of V'
  double largest = 0;                // 1 for 8-bit data; 0: no bound

  std::size_t light_matrices() const { return lights.size() / (new_lights * measured_lights); }
};

// To every one of `views` with every one of `lights`. Throws input errors for measured data in
// layout `paired`, too many directions, and directions that are below the horizon.
Resampling resample_to(const BtfInfo& measured, const std::vector<Direction>& views,
                       const std::vector<Direction>& lights);

// To the grid of onion slices: pairs [phi][theta][alpha][beta], with lights in the surface's frame.
Resampling resample_to(const BtfInfo& measured, const OnionSizes& sizes);

// The masks of T' and their distances to the outline: those of the nearest measured views.
void take_masks(const BtfInfo& measured, const Resampling& resampling, BtfInfo& info);
std::size_t mask_bytes(const BtfInfo& measured, const Resampling& resampling);

}  // namespace weft
