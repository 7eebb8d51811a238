#include "weft/reference/cluster_seeds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/reference/random.hpp"

namespace weft::reference {
namespace {
// Points that were computed in float are the same within this part of the squared distances.
constexpr double same_points = 0x1p-40;
}  // namespace

std::vector<std::size_t> cluster_seeds(std::size_t dimension, std::span<const double> points,
                                       std::size_t count, std::uint64_t seed) {
  const std::size_t size = dimension == 0 ? 0 : points.size() / dimension;
  std::vector<std::size_t> seeds;
  if (size == 0 || count == 0) return seeds;
  // in [0, 1)
  const auto uniform = [&](std::size_t i) {
    return static_cast<double>(splitmix64(seed, i) >> 11) * 0x1p-53;
  };
  // squared distances to the nearest seed if `candidate` is one more; returns their sum
  const auto distances = [&](std::size_t candidate, const std::vector<double>& nearest,
                             std::vector<double>& out) {
    const double* seed_point = points.data() + candidate * dimension;
    double sum = 0;
    for (std::size_t p = 0; p < size; ++p) {
      const double* point = points.data() + p * dimension;
      double square = 0;
      for (std::size_t d = 0; d < dimension; ++d) {
        square += (point[d] - seed_point[d]) * (point[d] - seed_point[d]);
      }
      out[p] = std::min(nearest[p], square);
      sum += out[p];
    }
    return sum;
  };

  std::vector<double> nearest(size, std::numeric_limits<double>::infinity());
  std::vector<double> tried(size);
  std::vector<double> best(size);
  seeds.push_back(
      std::min(static_cast<std::size_t>(uniform(0) * static_cast<double>(size)), size - 1));
  double sum = distances(seeds[0], nearest, best);
  nearest.swap(best);
  const double alike = sum * same_points;
  const auto candidates = 2 + static_cast<std::size_t>(std::log(static_cast<double>(count)));
  std::size_t drawn = 0;
  while (seeds.size() < count && sum > alike) {
    double least = std::numeric_limits<double>::infinity();
    std::size_t chosen = size;
    for (std::size_t i = 0; i < candidates; ++i) {
      // the point at which the running sum passes a random part of the whole
      const double target = uniform(++drawn) * sum;
      double running = 0;
      std::size_t candidate = size;
      for (std::size_t p = 0; p < size; ++p) {
        if (nearest[p] == 0) continue;
        running += nearest[p];
        candidate = p;
        if (running > target) break;
      }
      if (candidate == size) continue;
      const double left = distances(candidate, nearest, tried);
      if (left < least) {
        least = left;
        chosen = candidate;
        best.swap(tried);
      }
    }
    if (chosen == size) break;
    seeds.push_back(chosen);
    sum = least;
    nearest.swap(best);
  }
  return seeds;
}

}  // namespace weft::reference
