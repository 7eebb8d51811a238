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
    // in double, where no square of a float overflows or vanishes
    const double x = double{view[0]}, y = double{view[1]}, z = double{view[2]};
    const double squares = x * x + y * y + z * z;
    if (!std::isfinite(squares) || !(squares > 0)) {
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
