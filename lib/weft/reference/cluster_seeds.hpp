// Starting points of a clustering: greedy k-means++ (Arthur & Vassilvitskii 2007).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace weft::reference {

// Numbers of up to `count` distinct points: the first any, each further one the best of a few
// drawn with a probability proportional to the squared distance from the nearest chosen one. Fewer
// where no others differ from the chosen by more than float rounding. points: [size][dimension],
// row-major.
std::vector<std::size_t> cluster_seeds(std::size_t dimension, std::span<const double> points,
                                       std::size_t count, std::uint64_t seed);

}  // namespace weft::reference
