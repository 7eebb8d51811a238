// kernels/clamp_values.cl: integers of the comparison, so results are exact.
#include "weft/ops/clamp_values.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"

namespace weft {
namespace {

void expect_clamped(std::size_t count, float largest) {
  Device device("auto");
  const std::vector<float> values = test::random_floats(count, 5);
  test::GuardedBuffer guarded(device, std::span<const float>(values), "values");
  ops::clamp_values(device, count, largest, guarded.buffer());
  std::vector<float> expected = values;
  for (float& value : expected) value = std::clamp(value, 0.0f, largest);
  EXPECT_TRUE(test::all_equal(guarded.values<float>(), expected)) << count;
  EXPECT_TRUE(guarded.intact());
}

TEST(ClampValues, SmallCountsRoundAChunk) {
  for (const std::size_t count : {1u, 7u, 8u, 9u, 2047u, 2048u, 2049u, 5000u}) {
    expect_clamped(count, 0.5f);
    expect_clamped(count, std::numeric_limits<float>::infinity());
  }
}

TEST(ClampValues, SmallSpecialValues) {
  Device device("auto");
  constexpr float infinity = std::numeric_limits<float>::infinity();
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  // once in a vector and once behind
  std::vector<float> values{nan, -infinity, infinity, -0.0f, 1e-45f, -1e-45f, 2, 1, nan, -1, 3};
  const std::vector<float> expected{0, 0, 1, 0, 1e-45f, 0, 1, 1, 0, 0, 1};
  test::GuardedBuffer guarded(device, std::span<const float>(values), "values");
  ops::clamp_values(device, values.size(), 1, guarded.buffer());
  EXPECT_TRUE(test::all_equal(guarded.values<float>(), expected));
  EXPECT_TRUE(guarded.intact());
}

}  // namespace
}  // namespace weft
