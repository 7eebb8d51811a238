// Texels of C channels in device buffers: the inverse of colour transforms, and channels picked.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/btf/colour_transform.hpp"
#include "weft/device/device.hpp"

namespace weft::ops {

// A transform made ready for invert_colour.
class InverseColour {
 public:
  // The transform is none that changes nothing.
  InverseColour(Device& device, const ColourTransform& transform, std::size_t channels);
  // Inverts it on `count` texels, in place. Does not wait.
  void invert(Device& device, std::size_t count, Buffer& texels) const;
  // Bytes on the device.
  static std::size_t bytes(const ColourTransform& transform, std::size_t channels);
  // Flops of one texel, about; functions count as eight.
  double texel_flops() const;

 private:
  int kind_;  // KIND of the kernel
  std::size_t channels_;
  Buffer numbers_;
};

// out[first + p][k] = in[p][list[k]] for `count` texels of `channels` channels. `list` is on the
// device, `kept` indices. Does not wait.
void pick_channels(Device& device, std::size_t count, std::size_t channels, const Buffer& in,
                   std::size_t kept, const Buffer& list, std::size_t first, Buffer& out);

}  // namespace weft::ops
