// Values between measured directions by radial basis functions, as a matrix that depends on the
// directions alone: value(d) = sum_i w_i(d) value_i.
//
// The interpolant is the biharmonic spline of Carr et al. 2001, "Reconstruction and Representation
// of 3D Objects with Radial Basis Functions", which Havran et al. cite (section 4.1): of all that
// pass through the measured values it is the one of least bending,
//
//   s(d) = p(d) + sum_i lambda_i |d - d_i|,   p linear in the direction's x, y, z,
//   sum_i lambda_i q(d_i) = 0 for every linear q,
//
// without smoothing (their rho = 0), so that measured values are kept. It reproduces what is linear
// in the direction: a constant, and the cosine of a diffuse surface. |d - d_i| is the chord. Its
// weights are those of
//
//   [Phi  P] [lambda]   [value]        w(d) = the first n of [Phi P; P^T 0]^-1 [|d - d_i|; p(d)]
//   [P^T  0] [  c   ] = [  0  ]
//
// The system is never singular: directions closer together than 1e-5 are one, whose value is the
// mean of theirs; and p has of x, y, z only the axes in which the directions spread (one direction:
// a constant). Directions outside the hull of the measured ones are clamped to its edge as
// Hemisphere does it, not extrapolated: few or badly spread directions can't make values run away.
// Weights sum to 1 and may be negative next to large changes: whoever needs values that are not
// negative clamps them.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "weft/btf/directions.hpp"
#include "weft/btf/hemisphere.hpp"

namespace weft {

// phi(r): the biharmonic spline's r, as above, which has a cone's tip at every measured direction;
// or the thin-plate spline's r^2 log r, which has none, for surfaces that are looked at.
enum class RadialFunction { biharmonic, thin_plate };

class RadialBasis {
 public:
  using Vector = std::array<double, 3>;

  // The system of n directions is solved in O(n^3): more than these are refused.
  static constexpr std::size_t most_directions = 4096;

  // From 1 to most_directions directions. Throws an input error that names `what` ("view", "light")
  // and the first direction that is not finite or below the horizon.
  RadialBasis(std::span<const Direction> measured, std::string_view what,
              RadialFunction function = RadialFunction::biharmonic);

  std::size_t size() const { return count_; }

  // Weights of the measured values at a direction of length 1, written to `weights`, of size().
  // Returns the factor of values that contain the cosine of the light's direction: 1 inside the
  // hull, cos(theta) / cos(theta, clamped) outside, at most 4.
  double weigh(const Vector& direction, std::span<double> weights) const;

 private:
  void solve();
  double value(const Vector& a, const Vector& b) const;  // phi(|a - b|)
  // [phi(|d - d_i|); p(d)]
  std::vector<double> right_side(const Vector& direction) const;

  RadialFunction function_;
  std::size_t count_;
  std::vector<std::vector<std::size_t>> members_;  // of each distinct direction
  std::vector<Vector> distinct_;
  Hemisphere hull_;  // of the distinct ones
  std::array<double, 3> mean_{};
  std::vector<Vector> axes_;     // in which they spread, divided by by how much
  std::vector<double> inverse_;  // of the system, row-major
};

// Throws an input error that names `what` and the first direction that is not finite, of length 0
// or below the horizon.
void require_above_horizon(std::span<const Direction> directions, std::string_view what);

}  // namespace weft
