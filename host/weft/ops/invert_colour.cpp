#include "weft/ops/invert_colour.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

constexpr std::size_t texel_chunk = 1024;

enum InverseKind : int { linear = 0, log = 1, logluv = 2 };

InverseKind inverse_kind(const ColourTransform& transform) {
  if (transform.is_linear()) return linear;
  return transform.kind == ColourTransform::Kind::log ? log : logluv;
}

// As the kernel lists them.
std::vector<double> numbers_of(const ColourTransform& transform, std::size_t channels) {
  if (transform.is_linear()) return inverse_matrix(transform, channels);
  std::vector<double> numbers(channels, 1.0);
  for (std::size_t c = 0; c < transform.weights.size(); ++c) numbers[c] = 1 / transform.weights[c];
  numbers.push_back(transform.scale);
  numbers.push_back(largest_log(transform));
  if (transform.kind == ColourTransform::Kind::log) return numbers;
  const LuvDecoding luv = luv_decoding();
  for (const auto& row : luv.rows) numbers.insert(numbers.end(), row.begin(), row.end());
  numbers.insert(numbers.end(),
                 {luv.white_u, luv.white_v, luv.low_u, luv.high_u, luv.low_v, luv.high_v});
  return numbers;
}

}  // namespace

InverseColour::InverseColour(Device& device, const ColourTransform& transform, std::size_t channels)
    : kind_(inverse_kind(transform)),
      channels_(channels),
      numbers_(device, bytes(transform, channels), "colour transform") {
  const std::vector<double> numbers = numbers_of(transform, channels);
  const std::vector<float> rounded(numbers.begin(), numbers.end());
  device.write(numbers_, std::span<const float>(rounded));
}

void InverseColour::invert(Device& device, std::size_t count, Buffer& texels) const {
  const cl_kernel kernel = device.kernel(
      kernel_sources::invert_colour,
      fmt::format("-DKIND={} -DCHANNELS={} -DCHUNK={}", kind_, channels_, texel_chunk),
      "invert_colour");
  set_arguments(kernel, texels, ulong(count), numbers_);
  launch_items(device, kernel, ceil_div(count, texel_chunk));
}

std::size_t InverseColour::bytes(const ColourTransform& transform, std::size_t channels) {
  return numbers_of(transform, channels).size() * sizeof(float);
}

double InverseColour::texel_flops() const {
  const auto c = static_cast<double>(channels_);
  return kind_ == linear ? 2 * c * c : kind_ == log ? 10 * c : 50;
}

void pick_channels(Device& device, std::size_t count, std::size_t channels, const Buffer& in,
                   std::size_t kept, const Buffer& list, std::size_t first, Buffer& out) {
  const cl_kernel kernel =
      device.kernel(kernel_sources::pick_channels,
                    fmt::format("-DCHANNELS={} -DKEPT={} -DCHUNK={}", channels, kept, texel_chunk),
                    "pick_channels");
  set_arguments(kernel, in, ulong(count), list, ulong(first), out);
  launch_items(device, kernel, ceil_div(count, texel_chunk));
}

}  // namespace weft::ops
