#include "weft/btf/lookup.hpp"

#include <bit>
#include <cmath>
#include <limits>
#include <string_view>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr std::size_t most_indices = std::size_t{1} << 32;

void check_indices(std::size_t lookup, std::string_view group,
                   std::span<const std::uint32_t> indices, std::size_t limit) {
  for (const std::uint32_t index : indices) {
    if (index >= limit) {
      fail_input("look-up {}: {} {} is out of range, there are {}", lookup, group, index, limit);
    }
  }
}

}  // namespace

Lookup::Lookup(const LookupShape& shape, std::span<const std::uint32_t> words) {
  std::size_t next = 0;
  const auto take = [&](std::size_t count) {
    const auto part = words.subspan(next, count);
    next += count;
    return part;
  };
  texels = take(shape.texels);
  views = take(shape.views);
  lights = take(shape.lights);
  texel_weights_ = take(shape.texels > 1 ? shape.texels : 0);
  view_weights_ = take(shape.views > 1 ? shape.views : 0);
  light_weights_ = take(shape.lights > 1 ? shape.lights : 0);
}

double Lookup::weight(std::span<const std::uint32_t> words, std::size_t tap) {
  return words.empty() ? 1.0 : static_cast<double>(std::bit_cast<float>(words[tap]));
}

void validate(const LookupShape& lookup, const BtfShape& shape) {
  if ((lookup.texels != 1 && lookup.texels != 4) || (lookup.views != 1 && lookup.views != 3) ||
      (lookup.lights != 1 && lookup.lights != 3)) {
    fail_input(
        "look-ups of {} texels, {} views and {} lights: 1 or 4, 1 or 3, and 1 or 3 are known",
        lookup.texels, lookup.views, lookup.lights);
  }
  if (shape.texels() > most_indices || shape.views > most_indices || shape.lights > most_indices) {
    fail_input("look-ups: {} texels, {} views or {} lights don't fit indices of 32 bits",
               shape.texels(), shape.views, shape.lights);
  }
}

void validate_lookups(const LookupShape& lookup, const BtfShape& shape,
                      std::span<const std::uint32_t> records) {
  validate(lookup, shape);
  const std::size_t words = lookup.words();
  if (records.size() % words != 0) {
    fail_input("look-ups: {} words are no whole number of records of {}", records.size(), words);
  }
  for (std::size_t i = 0; i * words < records.size(); ++i) {
    const auto record = records.subspan(i * words, words);
    const Lookup taps(lookup, record);
    check_indices(i, "texel", taps.texels, shape.texels());
    check_indices(i, "view", taps.views, shape.views);
    check_indices(i, "light", taps.lights, shape.lights);
    for (const std::uint32_t word : record.subspan(lookup.taps())) {
      const float weight = std::bit_cast<float>(word);
      if (!std::isfinite(weight)) fail_input("look-up {}: a weight is {}", i, weight);
    }
  }
}

}  // namespace weft
