// Channels from before the texels to behind them: kernels/turn_channels.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

// to, [images][texels][C], from [images][C][texels], floats.
void turn_channels(Device& device, std::size_t images, std::size_t channels, std::size_t texels,
                   const Buffer& from, Buffer& to);

}  // namespace weft::ops
