#include "bench/measure.hpp"

#include <algorithm>
#include <chrono>

#include "weft/error.hpp"

namespace weft {

double time_once(Device& device, const Run& run) {
  using Clock = std::chrono::steady_clock;
  check_interrupt();
  const Clock::time_point start = Clock::now();
  run();
  device.finish();
  return std::chrono::duration<double>(Clock::now() - start).count();
}

Times measure(Device& device, std::size_t repeat, const Run& run) {
  time_once(device, run);
  std::vector<double> seconds(repeat);
  for (double& value : seconds) value = time_once(device, run);
  return {*std::ranges::min_element(seconds), median(seconds)};
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace weft
