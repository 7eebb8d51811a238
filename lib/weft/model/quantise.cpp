#include "weft/model/quantise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr int step_digits = 9;
constexpr int least_exponent = -149;  // of float's subnormals

// Calls run(component, first, place, count) for each run of values that belong to one component:
// `first` in the tensor, `place` in [components][outer][inner].
template <typename Run>
void for_each_run(const ComponentLayout& layout, const Run& run) {
  // An empty tensor may claim any number of outer indices.
  if (layout.components == 0 || layout.inner == 0) return;
  for (std::size_t c = 0; c < layout.components; ++c) {
    for (std::size_t o = 0; o < layout.outer; ++o) {
      run(c, (o * layout.components + c) * layout.inner, (c * layout.outer + o) * layout.inner,
          layout.inner);
    }
  }
}

// The nearest code whose product with the step is finite.
std::int32_t code_of(float value, float step, std::int32_t largest) {
  if (step == 0) return 0;
  const double nearest = std::nearbyint(double{value} / double{step});
  const double bound = largest;
  auto code = static_cast<std::int32_t>(std::clamp(nearest, -bound, bound));
  // at the end of float's range the code above may be past it
  if (!std::isfinite(static_cast<float>(code) * step)) code -= code > 0 ? 1 : -1;
  return code;
}

}  // namespace

float step_at_least(double step) {
  if (step == 0) return 0;
  int exponent = 0;
  std::frexp(step, &exponent);  // step = m 2^exponent, m in [1/2, 1)
  const int unit = std::max(exponent - step_digits, least_exponent);
  return static_cast<float>(std::ldexp(std::ceil(std::ldexp(step, -unit)), unit));
}

std::vector<float> component_peaks(std::span<const float> values, const ComponentLayout& layout) {
  std::vector<float> peaks(layout.components, 0.0f);
  for_each_run(layout, [&](std::size_t component, std::size_t first, std::size_t, std::size_t n) {
    for (const float value : values.subspan(first, n)) {
      peaks[component] = std::max(peaks[component], std::abs(value));
    }
  });
  return peaks;
}

std::vector<float> steps_of_bits(std::span<const float> peaks, unsigned bits) {
  const double largest = largest_code(bits);
  std::vector<float> steps;
  steps.reserve(peaks.size());
  for (const float peak : peaks) {
    steps.push_back(step_at_least(double{peak} / largest));
  }
  return steps;
}

unsigned bits_of_steps(std::span<const float> peaks, std::span<const float> steps) {
  unsigned bits = least_bits;
  for (std::size_t c = 0; c < peaks.size(); ++c) {
    if (steps[c] == 0) continue;
    const double code = std::nearbyint(double{peaks[c]} / double{steps[c]});
    while (bits < most_bits && code > largest_code(bits)) ++bits;
  }
  return bits;
}

void quantise(std::span<float> values, const ComponentLayout& layout,
              const Quantisation& quantisation) {
  const std::int32_t largest = largest_code(quantisation.bits);
  for_each_run(layout, [&](std::size_t component, std::size_t first, std::size_t, std::size_t n) {
    const float step = quantisation.steps[component];
    for (float& value : values.subspan(first, n)) {
      value = static_cast<float>(code_of(value, step, largest)) * step;
    }
  });
}

std::vector<std::int32_t> codes_of(std::span<const float> values, const ComponentLayout& layout,
                                   const Quantisation& quantisation, std::string_view where) {
  if (quantisation.steps.size() != layout.components) {
    fail_runtime("{}: {} steps for {} components", where, quantisation.steps.size(),
                 layout.components);
  }
  const std::int32_t largest = largest_code(quantisation.bits);
  std::vector<std::int32_t> codes(values.size());
  for_each_run(
      layout, [&](std::size_t component, std::size_t first, std::size_t place, std::size_t n) {
        const float step = quantisation.steps[component];
        for (std::size_t i = 0; i < n; ++i) {
          const float value = values[first + i];
          const std::int32_t code = code_of(value, step, largest);
          if (static_cast<float>(code) * step != value) {
            fail_runtime("{}: value {} at index {} is no multiple of the step {} of {} bits", where,
                         value, first + i, step, quantisation.bits);
          }
          codes[place + i] = code;
        }
      });
  return codes;
}

std::vector<float> values_of(std::span<const std::int32_t> codes, const ComponentLayout& layout,
                             std::span<const float> steps) {
  std::vector<float> values(codes.size());
  for_each_run(layout,
               [&](std::size_t component, std::size_t first, std::size_t place, std::size_t n) {
                 for (std::size_t i = 0; i < n; ++i) {
                   values[first + i] = static_cast<float>(codes[place + i]) * steps[component];
                 }
               });
  return values;
}

}  // namespace weft
