// Random records of look-ups.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "support/generators.hpp"
#include "weft/btf/lookup.hpp"

namespace weft::test {

// `count` look-ups of random taps, weights at least 0 with sum 1 in each group, some of them 0.
inline std::vector<std::uint32_t> random_lookups(const LookupShape& lookup, const BtfShape& shape,
                                                 std::size_t count, Random& random) {
  std::vector<std::uint32_t> records;
  const auto add_indices = [&](std::size_t taps, std::size_t limit) {
    for (std::size_t t = 0; t < taps; ++t) {
      records.push_back(static_cast<std::uint32_t>(random.index(limit)));
    }
  };
  const auto add_weights = [&](std::size_t taps) {
    if (taps == 1) return;
    std::vector<double> weights(taps);
    double sum = 0;
    for (double& weight : weights) {
      weight = random.index(4) == 0 ? 0.0 : random.uniform();
      sum += weight;
    }
    for (const double weight : weights) {
      const auto share = static_cast<float>(sum > 0 ? weight / sum : 0.0);
      records.push_back(std::bit_cast<std::uint32_t>(share));
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    add_indices(lookup.texels, shape.texels());
    add_indices(lookup.views, shape.views);
    add_indices(lookup.lights, shape.lights);
    add_weights(lookup.texels);
    add_weights(lookup.views);
    add_weights(lookup.lights);
  }
  return records;
}

}  // namespace weft::test
