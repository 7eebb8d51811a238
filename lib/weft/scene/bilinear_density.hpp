// A density over the unit square that is bilinear between the centres of rows x columns cells, and
// goes on as it is in the half cells at the edges.
//
//   F(s, t) = sum_{i,k} hat_i(s rows - 1/2) hat_k(t columns - 1/2) F_ik,     p = F / mean of F_ik
//
// with s down the rows: mean F_ik is the integral of F, exactly. A place is drawn by inversion: s
// from the sums of rows, which are linear between their centres, t from the row interpolated there.
// Both are continuous in their numbers where F is above 0.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace weft {

struct SquareSample {
  std::array<double, 2> place{};
  double density = 0;
};

class BilinearDensity {
 public:
  // nodes [rows][columns], finite and not negative, with a sum above 0.
  BilinearDensity(std::size_t rows, std::size_t columns, std::vector<double> nodes);

  // The place in [0, 1]^2 that belongs to two numbers in [0, 1), and p there.
  SquareSample sample(const std::array<double, 2>& numbers) const;
  // p
  double at(const std::array<double, 2>& place) const;

 private:
  std::size_t rows_, columns_;
  std::vector<double> nodes_;
  std::vector<double> row_sums_;
  double mean_ = 0;
};

}  // namespace weft
