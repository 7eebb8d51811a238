#include "weft/scene/light_sampling.hpp"

#include <cmath>
#include <cstddef>

#include "weft/error.hpp"

namespace weft {

void validate_light_queries(const BtfShape& shape, std::span<const LightQuery> queries) {
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const auto& [view, texel] = queries[i];
    if (texel >= shape.texels()) {
      fail_input("query {}: texel {} of {}", i, texel, shape.texels());
    }
    const float length = std::hypot(view[0], view[1], view[2]);
    if (!std::isfinite(length) || !(length > 0)) {
      fail_input("query {}: view ({}, {}, {}) is no direction", i, view[0], view[1], view[2]);
    }
  }
}

void validate_light_numbers(std::span<const std::array<float, 2>> numbers) {
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    for (const float number : numbers[i]) {
      if (!(number >= 0 && number < 1)) {
        fail_input("query {}: number {} is not in [0, 1)", i, number);
      }
    }
  }
}

}  // namespace weft
