// The slices of a material over directions to light, as nodes of a density that can be drawn from.
//
// A slice is known at the measured lights, as linear luminance T_l. Node i of n x n cells of the
// hemisphere's chart (hemisphere_chart.hpp) is the mean over its cell of what the slice is between
// them,
//
//   F_i = mean over w in cell i of sum_l weight_l(w) factor(w) T_l
//
// with the weights of Hemisphere, and the factor cos(theta) of a `brdf`, DirectionWeights::scale of
// a `radiance`: a highlight at one light can't slip between the nodes. What is drawn from is
//
//   p = ((1 - e) F / mean F + e cos / mean cos) / 2 pi,    e = 0.1,
//
// interpolated between the cells' centres (bilinear_density.hpp): the second part covers what the
// nodes don't see, and is all where the slice is black.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/scene/bilinear_density.hpp"

namespace weft {

class LightNodes {
 public:
  // Of a material's lights; cells are about half as large as what belongs to one of them.
  LightNodes(std::span<const Direction> lights, Quantity quantity);

  // n, of so many lights
  static std::size_t side_of(std::size_t lights);
  std::size_t side() const { return side_; }
  std::size_t count() const { return side_ * side_; }
  std::size_t lights() const { return albedo_weights_.size(); }

  // F of T_l, [lights].
  void gather(std::span<const double> luminances, std::span<double> nodes) const;
  // The density of F, which is not negative.
  BilinearDensity density(std::span<const double> nodes) const;
  // albedo = sum_l albedo_weights[l] T_l, for each channel
  std::span<const double> albedo_weights() const { return albedo_weights_; }

  // The same for a device: node i is the sum of weights[k] T_{lights[k]}, k in [first[i],
  // first[i + 1]); defence[i] is e cos / mean cos.
  struct Tables {
    std::vector<std::uint32_t> first, lights;
    std::vector<float> weights, defence;
  };
  Tables tables() const;
  // e
  static constexpr double defensive_share = 0.1;

 private:
  struct Term {
    std::uint32_t light;
    double weight;
  };
  std::size_t side_;
  std::vector<std::size_t> first_;  // of each node's terms, and their end
  std::vector<Term> terms_;
  std::vector<double> defence_;
  std::vector<double> albedo_weights_;
};

// Luminance of linear light, negative channels counted as 0: with the primaries of Rec. 709 of
// three channels, the mean of any other number.
double slice_luminance(std::span<const double> channels);

// One slice's density over directions: p, and drawing from it.
struct LightOfSlice {
  std::array<double, 3> direction{0, 0, 1};
  double density = 0;  // per unit of solid angle
};
LightOfSlice draw_light(const BilinearDensity& slice, const std::array<double, 2>& numbers);
// 0 below the horizon.
double light_density(const BilinearDensity& slice, const std::array<double, 3>& direction);

}  // namespace weft
