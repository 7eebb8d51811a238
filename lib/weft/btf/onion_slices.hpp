// The grid of view and light directions of Havran et al., "Bidirectional Texture Function
// Compression Based on Multi-Level Vector Quantization", section 4.1.
//
// Views are (phi_v, theta_v) in regular steps. The hemisphere of the lights is turned with the
// view's azimuth and cut like an onion: slices run from pole A to pole B on the horizon, at right
// angles to the plane of the view; alpha says which slice, beta where on it (figure 4).
//
//   light, turned: x = l.(cos phi_v, sin phi_v, 0)       towards the view's azimuth
//                  y = l.(-sin phi_v, cos phi_v, 0)      towards pole B
//   (x, y, z) = (sin alpha cos beta, sin beta, cos alpha cos beta)     alpha, beta in [-90, 90]
//   sin beta = sin theta_i sin(phi_i - phi_v),   alpha = atan2(x, z)
//
// The mirrored view is then at beta = 0, alpha = -theta_v, in the middle of a slice, as the paper's
// text and figures have it; its equation 3, read with the azimuth of the slices' poles for phi_v,
// is the same. The solid angle of a patch is d alpha d(sin beta): what is uniform in alpha and
// sin beta is uniform over the hemisphere.
//
// Nodes, of which the first and the last are those of the whole range:
//
//   phi_k    = 360 k / n_phi                    k = 0 .. n_phi - 1, goes round
//   theta_j  = 90 j / (n_theta - 1)
//   alpha_a  = -90 + 180 a / (n_alpha - 1)
//   sin beta_b = -1 + 2 b / (n_beta - 1)        equidistant along the slice's chord (figure 5b)
//
// A size of 1 says that nothing depends on that angle: its one node is phi = 0 (an isotropic
// material: lights are still turned with the view), theta = 0, alpha = 0 or beta = 0.
//
// Seams. The zenith view is n_phi views of different turns, each with the lights turned by its phi.
// The poles of the slices (beta = -90, 90) are two directions, whatever alpha is. Lights and views
// below the horizon are brought to it at their azimuth.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "weft/btf/directions.hpp"

namespace weft {

struct OnionSizes {
  std::size_t phi = 16, theta = 7, alpha = 11, beta = 11;

  std::size_t views() const { return phi * theta; }
  std::size_t lights() const { return alpha * beta; }
  bool operator==(const OnionSizes&) const = default;
};

// Throws an input error that names `where` and the sizes unless all are at least 1, and the
// directions at most 2^24 for views and for lights.
void validate(const OnionSizes& sizes, std::string_view where);

// "11,11,7,16": n_alpha, n_beta, n_theta, n_phi, the order of the paper. Throws an input error that
// names `option` and the text for anything else.
OnionSizes parse_onion_sizes(std::string_view text, std::string_view option);

// Two neighbouring nodes and how far a place is from the first to the second, in [0, 1].
struct OnionStep {
  std::size_t low = 0, high = 0;
  double fraction = 0;
};

// A pair of directions in steps of the grid: phi in [0, n_phi), the others in [0, n - 1].
struct OnionPosition {
  double phi = 0, theta = 0, alpha = 0, beta = 0;
};

class OnionSlices {
 public:
  using Vector = std::array<double, 3>;

  explicit OnionSlices(const OnionSizes& sizes);

  const OnionSizes& sizes() const { return sizes_; }

  // Nodes in degrees; of beta the sine.
  double phi(std::size_t k) const;
  double theta(std::size_t j) const;
  double alpha(std::size_t a) const;
  double sine_beta(std::size_t b) const;
  // Whether all slices meet in node b.
  bool at_pole(std::size_t b) const { return sizes_.beta > 1 && (b == 0 || b + 1 == sizes_.beta); }

  // Directions at nodes, or anywhere in steps of the grid. Lights of a turn: in the surface's
  // frame.
  Vector view(double phi_steps, double theta_steps) const;
  Vector turned_light(double alpha_steps, double beta_steps) const;
  Vector light(double phi_steps, double alpha_steps, double beta_steps) const;

  // All views [phi][theta]; all lights [alpha][beta] as they are in the frame that is turned with
  // the view, and in the surface's frame for the views of node k of phi.
  std::vector<Direction> views() const;
  std::vector<Direction> turned_lights() const;
  std::vector<Direction> lights(std::size_t k) const;

  // Where a pair of directions, of any length above 0, lies. The zenith view has azimuth 0.
  OnionPosition at(const Vector& view, const Vector& light) const;

  OnionStep phi_step(double phi_steps) const;
  OnionStep theta_step(double steps) const { return step(steps, sizes_.theta); }
  OnionStep alpha_step(double steps) const { return step(steps, sizes_.alpha); }
  OnionStep beta_step(double steps) const { return step(steps, sizes_.beta); }

 private:
  static OnionStep step(double steps, std::size_t size);

  OnionSizes sizes_;
};

// `light` as seen from a view of azimuth phi (degrees): turned by -phi about the normal; and back.
OnionSlices::Vector turned_by(const OnionSlices::Vector& light, double phi);

}  // namespace weft
