// Sizes of tensors.
#pragma once

#include <cstddef>
#include <functional>
#include <numeric>
#include <span>

namespace weft {

// How many values a tensor of these sizes has; 1 without any.
inline std::size_t product(std::span<const std::size_t> sizes) {
  return std::accumulate(sizes.begin(), sizes.end(), std::size_t{1}, std::multiplies<>());
}

}  // namespace weft
