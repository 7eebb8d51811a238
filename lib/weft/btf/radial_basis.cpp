#include "weft/btf/radial_basis.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {
namespace {

using Vector = RadialBasis::Vector;

// As in Hemisphere: directions closer than this are one.
constexpr double same_direction = 1e-5;
// A spread of this size is rounding.
constexpr double least_spread = 1e-6;
// What rounding to float may put below the horizon.
constexpr double horizon = -1e-6;

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double distance(const Vector& a, const Vector& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

Vector unit(const Direction& d) {
  const Vector v{d[0], d[1], d[2]};
  const double length = std::hypot(v[0], v[1], v[2]);
  return {v[0] / length, v[1] / length, v[2] / length};
}

std::vector<Vector> checked(std::span<const Direction> directions, std::string_view what) {
  if (directions.empty() || directions.size() > RadialBasis::most_directions) {
    fail_input("{} {} directions: from 1 to {} can be interpolated between", directions.size(),
               what, RadialBasis::most_directions);
  }
  require_above_horizon(directions, what);
  std::vector<Vector> units;
  units.reserve(directions.size());
  for (const Direction& direction : directions) units.push_back(unit(direction));
  return units;
}

// Indices of directions that are one, under the lowest of each; in ascending order.
std::vector<std::vector<std::size_t>> groups_of(std::span<const Vector> directions) {
  std::vector<std::size_t> root(directions.size());
  std::iota(root.begin(), root.end(), std::size_t{0});
  const auto find = [&root](std::size_t i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  for (std::size_t i = 0; i < directions.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (distance(directions[i], directions[j]) > same_direction) continue;
      const std::size_t a = find(i), b = find(j);
      root[std::max(a, b)] = std::min(a, b);
    }
  }
  std::vector<std::vector<std::size_t>> groups(directions.size());
  for (std::size_t i = 0; i < directions.size(); ++i) groups[find(i)].push_back(i);
  std::erase_if(groups, [](const auto& group) { return group.empty(); });
  return groups;
}

std::vector<Direction> first_of(std::span<const Direction> directions,
                                const std::vector<std::vector<std::size_t>>& groups) {
  std::vector<Direction> firsts;
  firsts.reserve(groups.size());
  for (const auto& group : groups) firsts.push_back(directions[group.front()]);
  return firsts;
}

}  // namespace

void require_above_horizon(std::span<const Direction> directions, std::string_view what) {
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Direction& d = directions[i];
    const double length = std::hypot(double{d[0]}, double{d[1]}, double{d[2]});
    if (!std::isfinite(length) || length == 0 || d[2] < horizon * length) {
      fail_input("{} direction {} is ({:.6g}, {:.6g}, {:.6g}): {}", what, i, d[0], d[1], d[2],
                 d[2] < 0 ? "it is below the horizon" : "it is no direction");
    }
  }
}

RadialBasis::RadialBasis(std::span<const Direction> measured, std::string_view what,
                         RadialFunction function)
    : function_(function),
      count_(measured.size()),
      members_(groups_of(checked(measured, what))),
      hull_(first_of(measured, members_)) {
  for (const auto& group : members_) distinct_.push_back(unit(measured[group.front()]));
  // The axes in which they spread.
  const auto n = static_cast<double>(distinct_.size());
  for (const Vector& d : distinct_) {
    for (std::size_t k = 0; k < 3; ++k) mean_[k] += d[k] / n;
  }
  std::vector<double> covariance(9, 0.0);
  for (const Vector& d : distinct_) {
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        covariance[i * 3 + k] += (d[i] - mean_[i]) * (d[k] - mean_[k]) / n;
      }
    }
  }
  const reference::SymmetricEigen spread = reference::symmetric_eigen(3, covariance);
  for (std::size_t j = 0; j < 3; ++j) {
    const double deviation = std::sqrt(std::max(spread.values[j], 0.0));
    if (deviation <= least_spread) continue;
    axes_.push_back({spread.vectors[j] / deviation, spread.vectors[3 + j] / deviation,
                     spread.vectors[6 + j] / deviation});
  }
  solve();
}

void RadialBasis::solve() {
  const std::size_t n = distinct_.size(), size = n + 1 + axes_.size();
  std::vector<double> system(size * size, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const std::vector<double> row = right_side(distinct_[i]);
    for (std::size_t k = 0; k < size; ++k) {
      system[i * size + k] = row[k];
      system[k * size + i] = row[k];
    }
  }
  inverse_ = reference::inverse(size, system);
}

double RadialBasis::value(const Vector& a, const Vector& b) const {
  const double r = distance(a, b);
  if (function_ == RadialFunction::biharmonic) return r;
  return r > 0 ? r * r * std::log(r) : 0;
}

std::vector<double> RadialBasis::right_side(const Vector& direction) const {
  std::vector<double> side;
  side.reserve(distinct_.size() + 4);
  for (const Vector& d : distinct_) side.push_back(value(direction, d));
  side.push_back(1);
  const Vector offset{direction[0] - mean_[0], direction[1] - mean_[1], direction[2] - mean_[2]};
  for (const Vector& axis : axes_) side.push_back(dot(axis, offset));
  return side;
}

double RadialBasis::weigh(const Vector& direction, std::span<double> weights) const {
  std::fill(weights.begin(), weights.end(), 0.0);
  const auto share = [&](std::size_t i, double weight) {
    const auto& group = members_[i];
    for (const std::size_t member : group) {
      weights[member] = weight / static_cast<double>(group.size());
    }
  };
  // A measured direction keeps its value to the bit.
  const auto is_measured = [&](const Vector& d) {
    for (std::size_t i = 0; i < distinct_.size(); ++i) {
      if (distance(d, distinct_[i]) > same_direction) continue;
      share(i, 1);
      return true;
    }
    return false;
  };
  const Vector above{direction[0], direction[1], std::max(direction[2], 0.0)};
  if (is_measured(above)) return 1;
  // Clamp to the hull.
  const DirectionWeights place = hull_.at(above);
  Vector inside{};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      inside[i] += place.weight[k] * distinct_[place.index[k]][i];
    }
  }
  const double length = std::hypot(inside[0], inside[1], inside[2]);
  if (length > same_direction) {
    for (double& x : inside) x /= length;
  } else {
    inside = above;  // between two opposite directions there is no nearest one
  }
  if (is_measured(inside)) return place.scale;
  // Weigh.
  const std::vector<double> side = right_side(inside);
  const std::size_t size = side.size();
  for (std::size_t i = 0; i < distinct_.size(); ++i) {
    double weight = 0;
    for (std::size_t k = 0; k < size; ++k) weight += inverse_[i * size + k] * side[k];
    share(i, weight);
  }
  return place.scale;
}

}  // namespace weft
