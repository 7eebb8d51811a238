// The figures of a reconstruction's error, against values worked out by hand.
#include "weft/metrics/error_sums.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace weft {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

// T = (3, 4), T' = (3, 4.5): sum T^2 = 25, sum of squared differences = 0.25.
ErrorSums small_sums() {
  return {2, 25.0, 0.25, 0.5, 4.0};
}

TEST(ErrorSums, ReportMatchesTheFormulas) {
  const ErrorReport result = report(small_sums(), 4.0);
  EXPECT_EQ(result.count, 2u);
  EXPECT_DOUBLE_EQ(result.rmse, std::sqrt(0.125));
  EXPECT_EQ(result.peak, 4.0);
  EXPECT_NEAR(result.psnr, 20 * std::log10(4 / std::sqrt(0.125)), 1e-12);
  EXPECT_NEAR(result.snr, 20.0, 1e-12);  // 10 log10(100)
  EXPECT_DOUBLE_EQ(result.relative, 0.1);
  EXPECT_EQ(result.max_error, 0.5);
}

TEST(ErrorSums, MergeAddsSumsAndKeepsTheLargest) {
  ErrorSums sums = small_sums();
  sums.merge({3, 1.0, 2.0, 1.5, 1.0});
  EXPECT_EQ(sums.count, 5u);
  EXPECT_EQ(sums.square_reference, 26.0);
  EXPECT_EQ(sums.square_difference, 2.25);
  EXPECT_EQ(sums.max_difference, 1.5);
  EXPECT_EQ(sums.max_reference, 4.0);
  sums.merge(ErrorSums{});
  EXPECT_EQ(sums.count, 5u);
  EXPECT_EQ(sums.max_difference, 1.5);
}

TEST(ErrorSums, NanIsNotLostInAMerge) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ErrorSums sums{1, 1.0, nan, nan, 1.0};
  sums.merge(small_sums());
  EXPECT_TRUE(std::isnan(sums.max_difference));
  EXPECT_TRUE(std::isnan(report(sums, 1).rmse));
  ErrorSums other = small_sums();
  other.merge({1, 1.0, nan, nan, 1.0});
  EXPECT_TRUE(std::isnan(other.max_difference));
}

TEST(ErrorSums, ExactReconstruction) {
  for (const double square_reference : {25.0, 0.0}) {
    const ErrorReport result = report({2, square_reference, 0, 0, 4}, 1.0);
    EXPECT_EQ(result.rmse, 0);
    EXPECT_EQ(result.psnr, inf);
    EXPECT_EQ(result.snr, inf);
    EXPECT_EQ(result.relative, 0);
  }
}

TEST(ErrorSums, AllZeroReference) {
  const ErrorReport result = report({4, 0, 1, 1, 0}, 1.0);
  EXPECT_DOUBLE_EQ(result.rmse, 0.5);
  EXPECT_TRUE(std::isnan(result.snr));
  EXPECT_EQ(result.relative, inf);
}

TEST(ErrorSums, OverflowIsInfiniteAndExtremesAreNot) {
  const ErrorReport overflowed = report({4, inf, inf, 1e200, 1e200}, 1.0);
  EXPECT_EQ(overflowed.rmse, inf);
  EXPECT_EQ(overflowed.psnr, -inf);
  EXPECT_EQ(overflowed.snr, -inf);
  EXPECT_EQ(overflowed.relative, inf);
  // Neither the quotient nor the product of the sums may leave the range.
  const ErrorReport wide = report({1, 1e-300, 1e300, 1e150, 1e-150}, 1.0);
  EXPECT_NEAR(wide.snr, -6000, 1e-9);
  EXPECT_NEAR(wide.relative / 1e300, 1, 1e-12);
}

TEST(ErrorSums, JsonSaysInfinityAndNanInWords) {
  ErrorReport result = report(small_sums(), 4.0);
  auto json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json.at("rmse").get<double>(), result.rmse);
  EXPECT_EQ(json.at("psnr").get<double>(), result.psnr);
  EXPECT_EQ(json.at("psnr_peak").get<double>(), 4.0);
  EXPECT_EQ(json.at("snr").get<double>(), result.snr);
  EXPECT_EQ(json.at("relative").get<double>(), result.relative);
  EXPECT_EQ(json.at("max_error").get<double>(), 0.5);
  result.psnr = inf;
  result.snr = std::numeric_limits<double>::quiet_NaN();
  result.relative = -inf;
  json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json.at("psnr"), "inf");
  EXPECT_EQ(json.at("snr"), "nan");
  EXPECT_EQ(json.at("relative"), "-inf");
}

}  // namespace
}  // namespace weft
