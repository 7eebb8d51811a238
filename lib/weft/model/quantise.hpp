// Uniform quantisation of a real-valued tensor, a step per component: value = step code, so that
// zero stays zero. Steps have 9 significant bits at most: with codes of 15 bits and a sign their
// products are exact floats, and |value - quantised| <= step / 2 holds to the last bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/model/component_scale.hpp"
#include "weft/model/model.hpp"

namespace weft {

inline constexpr unsigned least_bits = 4;
inline constexpr unsigned most_bits = 16;

// The largest code of so many bits, 2^(bits - 1) - 1.
constexpr std::int32_t largest_code(unsigned bits) {
  return static_cast<std::int32_t>((1u << (bits - 1)) - 1);
}

// The least step that is no less than `step`, which is finite and at least 0; 0 for 0.
float step_at_least(double step);

// The largest magnitude in each component. Values must be finite.
std::vector<float> component_peaks(std::span<const float> values, const ComponentLayout& layout);

// The least steps with which each component's largest magnitude is a code of so many bits.
std::vector<float> steps_of_bits(std::span<const float> peaks, unsigned bits);

// The fewest bits that hold the codes of components with these peaks, within 4 to 16.
unsigned bits_of_steps(std::span<const float> peaks, std::span<const float> steps);

// Rounds each value to the nearest code times the step. Idempotent.
void quantise(std::span<float> values, const ComponentLayout& layout,
              const Quantisation& quantisation);

// The codes of values that are quantised: in the order [components][outer][inner], in which what is
// alike stands together. Throws a run-time error that names `where` and the index of a value that
// is none.
std::vector<std::int32_t> codes_of(std::span<const float> values, const ComponentLayout& layout,
                                   const Quantisation& quantisation, std::string_view where);

// The inverse.
std::vector<float> values_of(std::span<const std::int32_t> codes, const ComponentLayout& layout,
                             std::span<const float> steps);

}  // namespace weft
