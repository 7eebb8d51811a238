// What a kernel is tuned by: an operation at a representative size that is timed, and a small one
// whose result is checked against the reference.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "bench/benchmark.hpp"
#include "tune/search.hpp"
#include "weft/device/device.hpp"
#include "weft/device/tunables.hpp"

namespace weft {

// Runs the small operation; empty if its result is right, else what is wrong with it.
using Check = std::function<std::string()>;

struct Trial {
  const TunableKernel* kernel = nullptr;
  Benchmark timed;
  // Makes the data and the expected result once.
  std::function<Check(Device&)> prepare_check;
};

// One file per family.
std::vector<Trial> product_trials();
std::vector<Trial> tile_trials();
std::vector<Trial> decoder_trials();
std::vector<Trial> pursuit_trials();
// All of them, by kernel.
std::vector<Trial> all_trials();

// A trial on a device.
class DeviceTrial : public TuneWork {
 public:
  DeviceTrial(Device& device, const Trial& trial);
  std::string check(const TuneValues& values) override;
  double time(const TuneValues& values) override;
  double now() override;

 private:
  Device& device_;
  const TunableKernel& kernel_;
  Check check_;
  Run run_;
};

// The first of the values that is farther from what is expected than its tolerance, as text; empty
// if there is none.
template <typename Actual, typename Tolerance>
std::string difference(const std::vector<Actual>& actual, const std::vector<double>& expected,
                       const Tolerance& tolerance);

// n unit / (1 - n unit): bounds the relative error of a sum of n products (Higham, Accuracy and
// Stability of Numerical Algorithms, section 3.1).
constexpr double error_bound(double n, double unit) {
  return n * unit / (1.0 - n * unit);
}
inline constexpr double float_unit = 0x1p-24;
inline constexpr double double_unit = 0x1p-53;

std::string describe_difference(std::size_t index, double actual, double expected,
                                double tolerance);

template <typename Actual, typename Tolerance>
std::string difference(const std::vector<Actual>& actual, const std::vector<double>& expected,
                       const Tolerance& tolerance) {
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const auto value = static_cast<double>(actual[i]);
    const double distance = value < expected[i] ? expected[i] - value : value - expected[i];
    if (distance <= tolerance(i)) continue;  // false for NaN
    return describe_difference(i, value, expected[i], tolerance(i));
  }
  return {};
}

}  // namespace weft
