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

template <typename Real>
void expect_multiply_adds(Arithmetic arithmetic, double roundoff) {
  Device device("auto");
  if (arithmetic == Arithmetic::f64 && !device.limits().has_fp64) return;
  for (const std::uint64_t rounds : {0, 1, 7, 100}) {
    const std::size_t items = 3, lanes = ops::vector_width(device, arithmetic);
    test::GuardedBuffer out(device, items * lanes * sizeof(Real), "sums");
    const cl_kernel kernel =
        device.kernel(kernel_sources::peak, ops::vector_option(device, arithmetic), "peak_fma");
    set_arguments(kernel, rounds, Real{0.5}, Real{0.25}, out.buffer());
    ops::launch_items(device, kernel, items);
    std::vector<double> expected(items * lanes);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      expected[i] = iterated(i % lanes, rounds, 0.5, 0.25);
    }
    // a start of a rounded product and sum, rounds of one rounding each, and the sum of twelve
    // below 14; the tenth itself is a float
    const double tolerance = 12 * 14 * test::gamma(static_cast<double>(rounds) + 15, roundoff) +
                             12 * 1.5 * test::float_roundoff;
    EXPECT_TRUE(test::all_near(out.values<Real>(), expected, tolerance)) << rounds;
    EXPECT_TRUE(out.intact());
  }
}

TEST(Peak, SmallMultiplyAddsAreAllDone) {
  expect_multiply_adds<float>(Arithmetic::f32, test::float_roundoff);
}

TEST(Peak, SmallMultiplyAddsInDoubleAreAllDone) {
  expect_multiply_adds<double>(Arithmetic::f64, test::double_roundoff);
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
  EXPECT_EQ(peaks.double_flops > 0, device.limits().has_fp64);
  EXPECT_TRUE(std::isfinite(peaks.bandwidth) && peaks.bandwidth > 0);
}

}  // namespace
}  // namespace weft
