// Times of operations on a device, by the host's clock.
#pragma once

#include <cstddef>
#include <vector>

#include "bench/benchmark.hpp"

namespace weft {

struct Times {
  double least = 0;
  double median = 0;
};

// Seconds of one run, until the device is idle.
double time_once(Device& device, const Run& run);

// Of `repeat` runs, after one that builds kernels and warms the caches.
Times measure(Device& device, std::size_t repeat, const Run& run);

// The middle value, the upper one of an even number; of one at least.
double median(std::vector<double> values);

}  // namespace weft
