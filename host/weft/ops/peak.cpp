#include "weft/ops/peak.hpp"

#include <algorithm>
#include <chrono>
#include <functional>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Seconds of the fastest of `repeat` runs, after one that builds and warms up.
double fastest(Device& device, std::size_t repeat, const std::function<void()>& run) {
  using Clock = std::chrono::steady_clock;
  run();
  device.finish();
  double best = 1e300;
  for (std::size_t i = 0; i < repeat; ++i) {
    const Clock::time_point start = Clock::now();
    run();
    device.finish();
    best = std::min(best, std::chrono::duration<double>(Clock::now() - start).count());
  }
  return best;
}

}  // namespace

Peaks measure_peaks(Device& device, std::size_t repeat) {
  Peaks peaks;
  {
    constexpr std::size_t rounds = 100000;
    constexpr double flops_per_round = 2.0 * 12 * 8;
    const std::size_t items = device.limits().compute_units * 16;
    Buffer out(device, items * 8 * sizeof(float), "peak");
    const cl_kernel kernel = device.kernel(kernel_sources::peak, "", "peak_fma");
    set_arguments(kernel, ulong(rounds), 0.999f, 0.001f, out);
    const double seconds = fastest(device, repeat, [&] { launch_items(device, kernel, items); });
    peaks.flops =
        static_cast<double>(items) * static_cast<double>(rounds) * flops_per_round / seconds;
  }
  {
    const std::size_t bytes =
        std::min<std::size_t>({std::size_t{256} << 20, device.limits().largest_allocation,
                               device.limits().global_memory / 8});
    const std::size_t vectors = bytes / (16 * sizeof(float));
    constexpr std::size_t chunk = 4096;
    Buffer from(device, bytes, "peak");
    Buffer to(device, bytes, "peak");
    device.fill_zero(from, 0, bytes);
    const cl_kernel kernel = device.kernel(kernel_sources::peak, "", "peak_copy");
    set_arguments(kernel, ulong(vectors), ulong(chunk), from, to);
    const double seconds =
        fastest(device, repeat, [&] { launch_items(device, kernel, ceil_div(vectors, chunk)); });
    peaks.bandwidth = 2.0 * static_cast<double>(bytes) / seconds;
  }
  return peaks;
}

}  // namespace weft::ops
