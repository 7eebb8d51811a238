// Directions of the upper hemisphere on a square grid of N x N entries, row-major, in the parabolic
// parameterisation (Heidrich & Seidel 1999), in which clustered tensors are resampled (Tsai & Shih
// 2012, section 6.3.2):
//
//   (p, q) = (x, y) / (1 + z)        column = floor((p + 1) N / 2), row = floor((q + 1) N / 2)
//
// The hemisphere is the unit disc; entries with their centre outside stand for the horizon.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/directions.hpp"
#include "weft/btf/radial_basis.hpp"

namespace weft {

inline constexpr std::size_t most_grid_side = 1024;

class ViewGrid {
 public:
  explicit ViewGrid(std::size_t side) : side_(side) {}

  std::size_t size() const { return side_ * side_; }
  // The unit vector at the centre of an entry, on the horizon at its azimuth if it is outside.
  std::array<double, 3> direction(std::size_t entry) const;
  // The entry that a vector of finite length above 0 is in. One below the horizon is first brought
  // to the horizon at its azimuth, straight down to azimuth 0.
  std::size_t entry(const std::array<double, 3>& direction) const;

 private:
  std::size_t side_;
};

// What views of such a grid are made of: weights of the measured views, by thin-plate splines on
// the sphere. They take any set of views, and leave no kink at a view or between triangles. Slices
// of a tensor are interpolated by the same weights as the rows of a full-rank view matrix, or as
// their products with anything.
class ViewResampling {
 public:
  ViewResampling(std::span<const Direction> views, std::size_t side)
      : grid_(side), splines_(views, "view", RadialFunction::thin_plate) {}

  std::size_t size() const { return grid_.size(); }
  // Of the measured views, for the centre of an entry; their sum is 1.
  std::vector<double> weights(std::size_t entry) const {
    std::vector<double> w(splines_.size());
    splines_.weigh(grid_.direction(entry), w);
    return w;
  }

 private:
  ViewGrid grid_;
  RadialBasis splines_;
};

}  // namespace weft
