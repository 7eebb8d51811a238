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

void check_direction(std::size_t lookup, std::string_view group, const std::array<float, 3>& d) {
  const float length = std::hypot(d[0], d[1], d[2]);
  if (!std::isfinite(length) || !(length > 0)) {
    fail_input("look-up {}: {} ({}, {}, {}) is no direction", lookup, group, d[0], d[1], d[2]);
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
  views = take(shape.directions ? 3 : shape.views);
  lights = take(shape.directions ? 3 : shape.lights);
  texel_weights_ = take(shape.texels > 1 ? shape.texels : 0);
  view_weights_ = take(shape.views > 1 ? shape.views : 0);
  light_weights_ = take(shape.lights > 1 ? shape.lights : 0);
}

double Lookup::weight(std::span<const std::uint32_t> words, std::size_t tap) {
  return words.empty() ? 1.0 : static_cast<double>(std::bit_cast<float>(words[tap]));
}

std::array<float, 3> Lookup::vector(std::span<const std::uint32_t> words) {
  return {std::bit_cast<float>(words[0]), std::bit_cast<float>(words[1]),
          std::bit_cast<float>(words[2])};
}

void validate(const LookupShape& lookup, const BtfShape& shape, bool takes_directions) {
  if ((lookup.texels != 1 && lookup.texels != 4) || (lookup.views != 1 && lookup.views != 3) ||
      (lookup.lights != 1 && lookup.lights != 3)) {
    fail_input(
        "look-ups of {} texels, {} views and {} lights: 1 or 4, 1 or 3, and 1 or 3 are known",
        lookup.texels, lookup.views, lookup.lights);
  }
  if (lookup.directions && !takes_directions) {
    fail_input("look-ups by directions: there are values of the measured directions alone");
  }
  if (lookup.directions && (lookup.views != 1 || lookup.lights != 1)) {
    fail_input("look-ups by directions of {} views and {} lights: one of each is known",
               lookup.views, lookup.lights);
  }
  if (shape.texels() > most_indices || shape.views > most_indices || shape.lights > most_indices) {
    fail_input("look-ups: {} texels, {} views or {} lights don't fit indices of 32 bits",
               shape.texels(), shape.views, shape.lights);
  }
}

void validate_lookups(const LookupShape& lookup, const BtfShape& shape,
                      std::span<const std::uint32_t> records) {
  validate(lookup, shape, true);
  const std::size_t words = lookup.words();
  if (records.size() % words != 0) {
    fail_input("look-ups: {} words are no whole number of records of {}", records.size(), words);
  }
  for (std::size_t i = 0; i * words < records.size(); ++i) {
    const auto record = records.subspan(i * words, words);
    const Lookup taps(lookup, record);
    check_indices(i, "texel", taps.texels, shape.texels());
    if (lookup.directions) {
      check_direction(i, "view", taps.view());
      check_direction(i, "light", taps.light());
    } else {
      check_indices(i, "view", taps.views, shape.views);
      check_indices(i, "light", taps.lights, shape.lights);
    }
    for (const std::uint32_t word : record.subspan(lookup.taps())) {
      const float weight = std::bit_cast<float>(word);
      if (!std::isfinite(weight)) fail_input("look-up {}: a weight is {}", i, weight);
    }
  }
}

}  // namespace weft
