// Peaks of a device, measured: kernels/peak.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

struct Peaks {
  double flops = 0;         // multiply-adds in float32, two flops each, per second
  double double_flops = 0;  // in float64; 0 where the device has none
  double bandwidth = 0;  // bytes read and written per second by a copy far larger than the caches
};

// The best of `repeat` runs of each; takes about 100 ms a run.
Peaks measure_peaks(Device& device, std::size_t repeat = 5);

}  // namespace weft::ops
