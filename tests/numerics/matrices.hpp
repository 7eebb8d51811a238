// The matrices of the numerical-stability suite: each is hard in one way.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "weft/ops/arithmetic.hpp"

namespace weft::numerics {

// K x m, row-major; every value is exact in the arithmetic it was made for.
struct Matrix {
  std::size_t rows = 0;
  std::size_t columns = 0;
  std::vector<double> values;

  double& at(std::size_t i, std::size_t j) { return values[i * columns + j]; }
};

struct Case {
  std::string name;
  std::string what;  // for the table
  std::function<Matrix(Arithmetic)> make;
  std::size_t rank = 0;  // components that are asked for
  // Size of the leading subspace that is compared: there is a gap behind it. 0: there is none.
  std::size_t leading = 0;
  // Rows repeat after so many, where there are too many for the reference; 0: they do not.
  std::size_t period = 0;
};

const std::vector<Case>& cases();
const Case& find_case(const std::string& name);

// The case of that name, with another number of rows.
Case long_sums(std::size_t rows);

// The singular values of the graded case before it was rounded: 10^(-j / 4), j = 0 .. 48.
std::vector<double> graded_values();

}  // namespace weft::numerics
