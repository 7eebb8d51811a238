// Channels from before the texels to behind them: kernels/turn_channels.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

// Images [count][rank][texels] at `offset` of a buffer that become [count][texels][channels]. With
// a factor U [channels][rank] they are multiplied by it; without one, rank is channels.
struct ChannelsFirst {
  const Buffer& buffer;
  std::size_t offset = 0;
  std::size_t count = 0;
  std::size_t texels = 0;
  std::size_t channels = 0;
  std::size_t rank = 0;
  const Buffer* factor = nullptr;
};

// To images at an offset of `to`.
void turn_channels(Device& device, const ChannelsFirst& images, Buffer& to, std::size_t to_offset);

// To the panels of a matrix [count][texels channels], as gemm_packed() takes it.
void pack_channels(Device& device, const ChannelsFirst& images, Buffer& panels);

}  // namespace weft::ops
