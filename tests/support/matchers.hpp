// Comparisons of whole arrays, which name the first element that differs:
//
//   EXPECT_TRUE(all_near(actual, expected, tolerance));
//
// NaN equals nothing; an infinity equals itself only.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <iterator>
#include <type_traits>

namespace weft::test {

// |actual[i] - expected[i]| <= tolerance(i) for every i. Differences are taken in double.
template <typename Actual, typename Expected, typename Tolerance>
requires std::is_invocable_v<Tolerance, std::size_t> testing::AssertionResult all_near(
    const Actual& actual, const Expected& expected, const Tolerance& tolerance) {
  if (std::size(actual) != std::size(expected)) {
    return testing::AssertionFailure()
           << std::size(actual) << " values where " << std::size(expected) << " are expected";
  }
  std::size_t failures = 0;
  std::size_t first = 0;
  for (std::size_t i = 0; i < std::size(actual); ++i) {
    const double a = static_cast<double>(actual[i]);
    const double e = static_cast<double>(expected[i]);
    // Written so that NaN anywhere, the tolerance included, is a failure.
    const bool near = a == e || std::abs(a - e) <= static_cast<double>(tolerance(i));
    if (near) continue;
    if (failures++ == 0) first = i;
  }
  if (failures == 0) return testing::AssertionSuccess();
  auto result = testing::AssertionFailure();
  result.operator<<(failures) << " of " << std::size(actual) << " values differ, first at index "
                              << first << ": ";
  const double a = static_cast<double>(actual[first]);
  const double e = static_cast<double>(expected[first]);
  return result << testing::PrintToString(a) << " where " << testing::PrintToString(e)
                << " is expected, difference " << std::abs(a - e) << ", tolerance "
                << static_cast<double>(tolerance(first));
}

// The same with one tolerance for all.
template <typename Actual, typename Expected>
testing::AssertionResult all_near(const Actual& actual, const Expected& expected,
                                  double tolerance) {
  return all_near(actual, expected, [tolerance](std::size_t) { return tolerance; });
}

// The same bits of the same value in every place; for integers, and for results that must not
// depend on tile sizes.
template <typename Actual, typename Expected>
testing::AssertionResult all_equal(const Actual& actual, const Expected& expected) {
  return all_near(actual, expected, 0.0);
}

// Bound of the rounding error of a sum of n products in an arithmetic with unit roundoff `u`
// (Higham, Accuracy and Stability, section 3.1): |error| <= gamma_n sum |a_i b_i|.
inline double gamma(double n, double u) {
  return n * u / (1.0 - n * u);
}
inline constexpr double float_roundoff = 0x1p-24;
inline constexpr double double_roundoff = 0x1p-53;
inline constexpr double half_roundoff = 0x1p-11;

}  // namespace weft::test
