#include "weft/model/component_scale.hpp"

#include <algorithm>
#include <cmath>

#include "weft/model/model.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

constexpr std::uint16_t half_2_to_15 = 0x7800;
constexpr std::uint16_t half_below_2_to_15 = 0x77ff;
constexpr std::uint16_t sign_bit = 0x8000;
constexpr int min_exponent = -126;
// 2^15 * 2^113 is past the range of float.
constexpr int max_exponent = 113;

std::uint16_t scaled_half(float value, float inverse_scale) {
  // The product is exact unless it is below float's normal range, where halves are zero anyway.
  const std::uint16_t half = float_to_half(value * inverse_scale);
  // Only where the scale is at its limit does rounding reach 2^15.
  return (half & ~sign_bit) < half_2_to_15
             ? half
             : static_cast<std::uint16_t>((half & sign_bit) | half_below_2_to_15);
}

float scale_for(float largest) {
  if (largest == 0) return 1;
  int exponent = 0;
  std::frexp(largest, &exponent);  // largest = m 2^exponent, m in [1/2, 1)
  exponent = std::max(exponent - 15, min_exponent);
  // Where rounding to half reaches 2^15, the next scale holds the rounded value, and gives itself
  // again when the rounded values are scaled.
  if (float_to_half(std::ldexp(largest, -exponent)) >= half_2_to_15) ++exponent;
  return std::ldexp(1.0f, std::min(exponent, max_exponent));
}

// Calls run(component, first, count) for each run of values that belong to one component.
template <typename Run>
void for_each_run(const ComponentLayout& layout, const Run& run) {
  // An empty tensor may claim any number of outer indices.
  if (layout.components == 0 || layout.inner == 0) return;
  for (std::size_t o = 0; o < layout.outer; ++o) {
    for (std::size_t c = 0; c < layout.components; ++c) {
      run(c, (o * layout.components + c) * layout.inner, layout.inner);
    }
  }
}

}  // namespace

ComponentLayout component_layout(std::span<const std::size_t> shape, std::size_t axis) {
  ComponentLayout layout;
  for (std::size_t i = 0; i < shape.size(); ++i) {
    if (axis == ModelTensor::no_component_axis || i > axis) {
      layout.inner *= shape[i];
    } else if (i < axis) {
      layout.outer *= shape[i];
    } else {
      layout.components = shape[i];
    }
  }
  return layout;
}

std::vector<float> component_scales(std::span<const float> values, const ComponentLayout& layout) {
  std::vector<float> largest(layout.components, 0.0f);
  for_each_run(layout, [&](std::size_t component, std::size_t first, std::size_t count) {
    for (const float value : values.subspan(first, count)) {
      largest[component] = std::max(largest[component], std::abs(value));
    }
  });
  std::transform(largest.begin(), largest.end(), largest.begin(), scale_for);
  return largest;
}

void to_scaled_half(std::span<const float> values, const ComponentLayout& layout,
                    std::span<const float> scales, std::span<std::uint16_t> out,
                    std::size_t first) {
  for (std::size_t i = 0; i < values.size();) {
    const std::size_t run = (first + i) / layout.inner;
    const std::size_t end = std::min(values.size(), (run + 1) * layout.inner - first);
    const float inverse = 1.0f / scales[run % layout.components];  // a power of two too
    for (; i < end; ++i) out[i] = scaled_half(values[i], inverse);
  }
}

void from_scaled_half(std::span<const std::uint16_t> halves, const ComponentLayout& layout,
                      std::span<const float> scales, std::span<float> out) {
  for_each_run(layout, [&](std::size_t component, std::size_t first, std::size_t count) {
    for (std::size_t i = first; i < first + count; ++i) {
      out[i] = half_to_float(halves[i]) * scales[component];
    }
  });
}

void round_to_scaled_half(std::span<float> values, const ComponentLayout& layout) {
  const std::vector<float> scales = component_scales(values, layout);
  for_each_run(layout, [&](std::size_t component, std::size_t first, std::size_t count) {
    const float inverse = 1.0f / scales[component];
    for (std::size_t i = first; i < first + count; ++i) {
      values[i] = half_to_float(scaled_half(values[i], inverse)) * scales[component];
    }
  });
}

}  // namespace weft
