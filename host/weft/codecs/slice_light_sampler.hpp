// Directions to light drawn on a device, from slices that are looked up and inverted.
#pragma once

#include <memory>

#include "weft/btf/btf.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/device/device.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft {

// Of a material that `info` describes and `sampler` looks up in: what reference/light_sampler.hpp
// does, for thousands of slices at once, in some 32 MiB of device memory. The device must outlive
// it.
std::unique_ptr<LightSampler> slice_light_sampler(Device& device, const BtfInfo& info,
                                                  std::unique_ptr<DeviceSampler> sampler);

}  // namespace weft
