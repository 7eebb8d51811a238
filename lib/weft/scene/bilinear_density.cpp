#include "weft/scene/bilinear_density.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace weft {
namespace {

// Where a coordinate in [0, 1] lies between the centres of cells.
struct Between {
  std::size_t below = 0, above = 0;
  double fraction = 0;  // of the one above
};

Between between(double coordinate, std::size_t cells) {
  const double position = std::clamp(coordinate * static_cast<double>(cells) - 0.5, 0.0,
                                     static_cast<double>(cells - 1));
  const auto below = static_cast<std::size_t>(position);
  return {below, std::min(below + 1, cells - 1), position - static_cast<double>(below)};
}

// The part x in [0, 1] of a step below which a density that runs from a to b has the area: of
// a x + (b - a) x^2 / 2 = area, the root that has no cancellation.
double part_of_step(double a, double b, double area) {
  const double root = std::sqrt(std::max(0.0, a * a + 2 * (b - a) * area));
  return area > 0 ? std::min(2 * area / (a + root), 1.0) : 0;
}

// The coordinate below which a share `number` of the density lies that is linear between value(i)
// at (i + 1/2) / cells.
template <typename Value>
double invert(std::size_t cells, const Value& value, double number) {
  double total = 0;
  for (std::size_t i = 0; i < cells; ++i) total += value(i);
  const auto count = static_cast<double>(cells);
  double left = number * total;
  // the half cell at the lower edge, the steps between centres, the half cell at the upper edge
  double low = value(0);
  if (left < low / 2) return left / low / count;
  left -= low / 2;
  for (std::size_t i = 0; i + 1 < cells; ++i) {
    const double high = value(i + 1);
    const double area = (low + high) / 2;
    if (left < area) {
      return (static_cast<double>(i) + 0.5 + part_of_step(low, high, left)) / count;
    }
    left -= area;
    low = high;
  }
  const double part = low > 0 ? std::min(left / low, 0.5) : 0;
  return std::min(1.0, (count - 0.5 + part) / count);
}

}  // namespace

BilinearDensity::BilinearDensity(std::size_t rows, std::size_t columns, std::vector<double> nodes)
    : rows_(rows), columns_(columns), nodes_(std::move(nodes)), row_sums_(rows) {
  double total = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t k = 0; k < columns; ++k) row_sums_[i] += nodes_[i * columns + k];
    total += row_sums_[i];
  }
  mean_ = total / static_cast<double>(rows * columns);
}

SquareSample BilinearDensity::sample(const std::array<double, 2>& numbers) const {
  SquareSample result;
  result.place[0] = invert(
      rows_, [&](std::size_t i) { return row_sums_[i]; }, numbers[0]);
  const Between row = between(result.place[0], rows_);
  const double* const below = &nodes_[row.below * columns_];
  const double* const above = &nodes_[row.above * columns_];
  const auto value = [&](std::size_t k) {
    return (1 - row.fraction) * below[k] + row.fraction * above[k];
  };
  result.place[1] = invert(columns_, value, numbers[1]);
  result.density = at(result.place);
  return result;
}

double BilinearDensity::at(const std::array<double, 2>& place) const {
  const Between row = between(place[0], rows_), column = between(place[1], columns_);
  const auto value = [&](std::size_t i) {
    return (1 - column.fraction) * nodes_[i * columns_ + column.below] +
           column.fraction * nodes_[i * columns_ + column.above];
  };
  return ((1 - row.fraction) * value(row.below) + row.fraction * value(row.above)) / mean_;
}

}  // namespace weft
