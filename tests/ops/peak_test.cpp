// kernels/peak.cl computes what its formula says, so that the peaks are those of real work.
#include "weft/ops/peak.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

// x <- x a + b from x = i + lane / 10, i < 12, summed over i.
double iterated(std::size_t lane, std::uint64_t rounds, double a, double b) {
  double sum = 0;
  for (std::size_t i = 0; i < 12; ++i) {
    double x = static_cast<double>(i) + 0.1 * static_cast<double>(lane);
    for (std::uint64_t round = 0; round < rounds; ++round) x = x * a + b;
    sum += x;
  }
  return sum;
}

TEST(Peak, SmallMultiplyAddsAreAllDone) {
  Device device("auto");
  for (const std::uint64_t rounds : {0, 1, 7, 100}) {
    const std::size_t items = 3;
    test::GuardedBuffer out(device, items * 8 * sizeof(float), "sums");
    const cl_kernel kernel = device.kernel(kernel_sources::peak, "", "peak_fma");
    set_arguments(kernel, rounds, 0.5f, 0.25f, out.buffer());
    ops::launch_items(device, kernel, items);
    std::vector<double> expected(items * 8);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      expected[i] = iterated(i % 8, rounds, 0.5, 0.25);
    }
    // a start of one rounded sum, rounds of one rounding each, and the sum of twelve below 12
    const double tolerance =
        12 * 12 * test::gamma(static_cast<double>(rounds) + 14, test::float_roundoff);
    EXPECT_TRUE(test::all_near(out.values<float>(), expected, tolerance)) << rounds;
    EXPECT_TRUE(out.intact());
  }
}

TEST(Peak, SmallCopyCopiesAll) {
  Device device("auto");
  for (const std::size_t vectors : {1, 3, 4, 5, 9}) {
    const std::vector<float> values = test::random_floats(vectors * 16, 1);
    test::GuardedBuffer from(device, std::span<const float>(values), "from");
    test::GuardedBuffer to(device, values.size() * sizeof(float), "to");
    const std::size_t chunk = 4;
    const cl_kernel kernel = device.kernel(kernel_sources::peak, "", "peak_copy");
    set_arguments(kernel, ops::ulong(vectors), ops::ulong(chunk), from.buffer(), to.buffer());
    ops::launch_items(device, kernel, ops::ceil_div(vectors, chunk));
    EXPECT_TRUE(test::all_equal(to.values<float>(), values)) << vectors;
    EXPECT_TRUE(to.intact());
  }
}

TEST(Peak, FiguresArePositive) {
  Device device("auto");
  const ops::Peaks peaks = ops::measure_peaks(device, 1);
  EXPECT_TRUE(std::isfinite(peaks.flops) && peaks.flops > 0);
  EXPECT_TRUE(std::isfinite(peaks.bandwidth) && peaks.bandwidth > 0);
}

}  // namespace
}  // namespace weft
