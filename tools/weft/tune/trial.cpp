#include "tune/trial.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <iterator>
#include <string_view>

#include "bench/measure.hpp"

namespace weft {

std::vector<Trial> all_trials() {
  std::vector<Trial> all;
  for (const auto family : {product_trials, tile_trials, decoder_trials, pursuit_trials}) {
    std::ranges::move(family(), std::back_inserter(all));
  }
  std::ranges::sort(all, {},
                    [](const Trial& trial) { return std::string_view(trial.kernel->name); });
  return all;
}

DeviceTrial::DeviceTrial(Device& device, const Trial& trial)
    : device_(device),
      kernel_(*trial.kernel),
      check_(trial.prepare_check(device)),
      run_(trial.timed.prepare(device)) {}

std::string DeviceTrial::check(const TuneValues& values) {
  device_.tune(kernel_, values, "trial");
  return check_();
}

double DeviceTrial::time(const TuneValues& values) {
  device_.tune(kernel_, values, "trial");
  return time_once(device_, run_);
}

double DeviceTrial::now() {
  using Seconds = std::chrono::duration<double>;
  return Seconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string describe_difference(std::size_t index, double actual, double expected,
                                double tolerance) {
  return fmt::format("value {} is {}, where {} is expected within {:.3g}", index, actual, expected,
                     tolerance);
}

}  // namespace weft
