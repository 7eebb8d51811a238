#include "weft/reference/kcta_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "weft/reference/cluster_seeds.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

constexpr std::size_t most_iterations = 100;

double distance(const SlicePoints& points, std::size_t p, std::span<const double> centre) {
  double sum = 0;
  for (std::size_t d = 0; d < points.dimension; ++d) {
    const double difference = points.values[p * points.dimension + d] - centre[d];
    sum += difference * difference;
  }
  return sum;
}

std::span<const double> point(const SlicePoints& points, std::size_t p) {
  return std::span(points.values).subspan(p * points.dimension, points.dimension);
}

std::vector<double> centres_of(const SlicePoints& points, std::size_t count,
                               std::span<const std::uint32_t> labels) {
  std::vector<double> centres(count * points.dimension, 0.0);
  std::vector<double> sizes(count, 0.0);
  for (std::size_t p = 0; p < points.size(); ++p) {
    sizes[labels[p]] += 1;
    for (std::size_t d = 0; d < points.dimension; ++d) {
      centres[labels[p] * points.dimension + d] += points.values[p * points.dimension + d];
    }
  }
  for (std::size_t i = 0; i < centres.size(); ++i) {
    centres[i] /= std::max(1.0, sizes[i / points.dimension]);
  }
  return centres;
}

// From seeds, which may be fewer than `count`.
std::vector<std::uint32_t> lloyd(const SlicePoints& points, std::size_t count,
                                 std::span<const std::size_t> seeds) {
  std::vector<double> centres;
  for (const std::size_t seed : seeds) {
    const std::span<const double> at = point(points, seed);
    centres.insert(centres.end(), at.begin(), at.end());
  }
  std::vector<std::uint32_t> labels;
  for (std::size_t i = 0; i < most_iterations; ++i) {
    std::vector<std::uint32_t> next(points.size(), 0);
    std::vector<double> errors(points.size(), std::numeric_limits<double>::infinity());
    for (std::size_t p = 0; p < points.size(); ++p) {
      for (std::size_t c = 0; c * points.dimension < centres.size(); ++c) {
        const double far =
            distance(points, p, std::span(centres).subspan(c * points.dimension, points.dimension));
        if (far < errors[p]) {
          errors[p] = far;
          next[p] = static_cast<std::uint32_t>(c);
        }
      }
    }
    fill_empty_clusters(count, 1, next, errors);
    if (next == labels) break;
    labels = std::move(next);
    centres = centres_of(points, count, labels);
  }
  return labels;
}

}  // namespace

std::string_view name_of(KctaStart start) {
  switch (start) {
    case KctaStart::directions:
      return "directions";
    case KctaStart::slices:
      return "slices";
    case KctaStart::random:
      return "random";
  }
  return "";
}

SlicePoints slice_parameters(const BtfInfo& info, const ModeGroups& groups, std::size_t group) {
  const ModeGroup& modes = groups.groups()[group];
  const BtfShape& shape = info.shape;
  SlicePoints points;
  for (std::size_t i = 0; i < modes.size; ++i) {
    const auto index = [&](Mode mode) { return i / groups.stride(mode) % mode_size(shape, mode); };
    std::vector<double> at;
    const auto add = [&](const Direction& direction) {
      const double length = std::hypot(direction[0], direction[1], direction[2]);
      for (const float d : direction) at.push_back(double{d} / length);
    };
    if (modes.has(Mode::view)) add(info.view_directions[index(Mode::view)]);
    if (modes.has(Mode::light)) add(info.light_directions[index(Mode::light)]);
    for (const Mode mode : {Mode::row, Mode::column}) {
      if (!modes.has(mode)) continue;
      at.push_back(static_cast<double>(index(mode)) /
                   static_cast<double>(std::max(shape.height, shape.width)));
    }
    if (at.empty()) at.push_back(static_cast<double>(i));  // channels by themselves
    points.dimension = at.size();
    points.values.insert(points.values.end(), at.begin(), at.end());
  }
  return points;
}

SlicePoints leading_subspace(std::size_t n, std::span<const double> gram, std::size_t dimension) {
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(n, gram);
  SlicePoints points;
  points.dimension = std::min(n, dimension);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t d = 0; d < points.dimension; ++d) {
      points.values.push_back(eigen.vectors[i * n + d] * std::sqrt(std::max(0.0, eigen.values[d])));
    }
  }
  return points;
}

std::vector<std::uint32_t> cluster_points(const SlicePoints& points, std::size_t count) {
  const std::vector<std::uint32_t> together(points.size(), 0);
  const std::vector<double> middle = centres_of(points, 1, together);
  // squared distance to the nearest seed; at first that to the middle, of which the least is taken
  std::vector<double> nearest(points.size());
  std::size_t next = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    nearest[p] = distance(points, p, middle);
    if (nearest[p] < nearest[next]) next = p;
  }
  std::fill(nearest.begin(), nearest.end(), std::numeric_limits<double>::infinity());
  std::vector<std::size_t> seeds;
  while (seeds.size() < count) {
    seeds.push_back(next);
    for (std::size_t p = 0; p < points.size(); ++p) {
      nearest[p] = std::min(nearest[p], distance(points, p, point(points, next)));
    }
    next = static_cast<std::size_t>(
        std::distance(nearest.begin(), std::max_element(nearest.begin(), nearest.end())));
  }
  return lloyd(points, count, seeds);
}

std::vector<std::uint32_t> cluster_points(const SlicePoints& points, std::size_t count,
                                          std::uint64_t seed) {
  return lloyd(points, count,
               reference::cluster_seeds(points.dimension, points.values, count, seed));
}

std::vector<std::uint32_t> deal_slices(std::size_t slices, std::size_t count, std::uint64_t seed) {
  std::vector<std::size_t> order(slices);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return reference::splitmix64(seed, a) < reference::splitmix64(seed, b);
  });
  std::vector<std::uint32_t> labels(slices);
  for (std::size_t i = 0; i < slices; ++i) labels[order[i]] = static_cast<std::uint32_t>(i % count);
  return labels;
}

std::vector<std::vector<std::size_t>> slices_of_clusters(std::size_t clusters, std::size_t mixtures,
                                                         std::span<const std::uint32_t> members) {
  std::vector<std::vector<std::size_t>> lists(clusters);
  for (std::size_t i = 0; i < members.size(); ++i) lists[members[i]].push_back(i / mixtures);
  return lists;
}

std::vector<SliceMove> fill_empty_clusters(std::size_t clusters, std::size_t mixtures,
                                           std::span<std::uint32_t> members,
                                           std::span<const double> errors) {
  std::vector<SliceMove> moves;
  std::vector<std::vector<std::size_t>> lists = slices_of_clusters(clusters, mixtures, members);
  for (std::size_t to = 0; to < clusters; ++to) {
    if (!lists[to].empty()) continue;
    // the largest error; between equals the most slices
    std::size_t from = clusters;
    double largest = 0;
    for (std::size_t c = 0; c < clusters; ++c) {
      if (lists[c].size() < 2) continue;
      double sum = 0;
      for (const std::size_t slice : lists[c]) sum += errors[slice];
      if (from == clusters || sum > largest ||
          (sum == largest && lists[c].size() > lists[from].size())) {
        from = c;
        largest = sum;
      }
    }
    std::vector<std::size_t> worst = lists[from];
    std::stable_sort(worst.begin(), worst.end(),
                     [&](std::size_t a, std::size_t b) { return errors[a] > errors[b]; });
    worst.resize(worst.size() / 2);
    for (const std::size_t slice : worst) {
      const auto row = members.subspan(slice * mixtures, mixtures);
      *std::find(row.begin(), row.end(), static_cast<std::uint32_t>(from)) =
          static_cast<std::uint32_t>(to);
      std::erase(lists[from], slice);
      moves.push_back({slice, static_cast<std::uint32_t>(from), static_cast<std::uint32_t>(to)});
    }
    std::sort(worst.begin(), worst.end());
    lists[to] = std::move(worst);
  }
  return moves;
}

}  // namespace weft
