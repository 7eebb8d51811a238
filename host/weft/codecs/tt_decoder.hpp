// Images and texels of a tensor train on the device.
//
// Where the views' and the lights' modes are neighbours at one end of the order, as by default, the
// other three cores are multiplied once, and so are those two: an image is a row of one times the
// other,
//
//   T[(v, l), (y, x, c)] = sum_r W[(v, l), r] M[r, (y, x, c)]
//
// In other orders the cores of the texels' modes that the order begins with are multiplied once,
// and the rest for each image, its slices first.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/codec.hpp"
#include "weft/model/tt.hpp"

namespace weft {

std::unique_ptr<DeviceDecoder> tt_decoder(Device& device, const TtModel& model);

// Bytes that it holds on the device and, while it is made, here.
std::size_t tt_decoder_bytes(const TtModel& model);

}  // namespace weft
