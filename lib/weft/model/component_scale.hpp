// F16 storage with a power of two per component, so that a component's largest half lies in
// [2^14, 2^15): value = half * scale. Every finite float magnitude is served alike: scales end at
// 2^-126, below which a half has room for all of float's subnormals (a subnormal scale might be
// flushed to zero by a device), and at 2^113, beyond which values would pass float's range.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace weft {

// A tensor seen as [outer][components][inner]; component_axis = none is [1][1][all].
struct ComponentLayout {
  std::size_t outer = 1;
  std::size_t components = 1;
  std::size_t inner = 1;
};

// The layout of `axis` of `shape`, or one component if axis is ModelTensor::no_component_axis.
ComponentLayout component_layout(std::span<const std::size_t> shape, std::size_t axis);

// One scale per component; 1 for an all-zero one. Values must be finite.
std::vector<float> component_scales(std::span<const float> values, const ComponentLayout& layout);

// Of the values from the tensor's index `first` on.
void to_scaled_half(std::span<const float> values, const ComponentLayout& layout,
                    std::span<const float> scales, std::span<std::uint16_t> out,
                    std::size_t first = 0);
void from_scaled_half(std::span<const std::uint16_t> halves, const ComponentLayout& layout,
                      std::span<const float> scales, std::span<float> out);

// Rounds values to what F16 storage will give back. Idempotent.
void round_to_scaled_half(std::span<float> values, const ComponentLayout& layout);

}  // namespace weft
