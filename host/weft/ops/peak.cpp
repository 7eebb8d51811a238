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

// Flops per second of multiply-adds in registers.
double measure_fma(Device& device, Arithmetic arithmetic, std::size_t repeat) {
  constexpr std::size_t rounds = 100000;
  const std::size_t lanes = vector_width(device, arithmetic);
  const double flops_per_round = 2.0 * 12 * static_cast<double>(lanes);
  const std::size_t items = device.limits().compute_units * 16;
  Buffer out(device, items * lanes * size_of(arithmetic), "peak");
  const cl_kernel kernel =
      device.kernel(kernel_sources::peak, vector_option(device, arithmetic), "peak_fma");
  with_real(arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    set_arguments(kernel, ulong(rounds), Real{0.999f}, Real{0.001f}, out);
  });
  const double seconds = fastest(device, repeat, [&] { launch_items(device, kernel, items); });
  return static_cast<double>(items) * static_cast<double>(rounds) * flops_per_round / seconds;
}

}  // namespace

Peaks measure_peaks(Device& device, std::size_t repeat) {
  Peaks peaks;
  peaks.flops = measure_fma(device, Arithmetic::f32, repeat);
  if (device.limits().has_fp64) {
    peaks.double_flops = measure_fma(device, Arithmetic::f64, repeat);
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
