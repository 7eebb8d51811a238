// The search of weft tune, on kernels that only exist here: times and results are made up.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "support/expect_error.hpp"
#include "tune/search.hpp"
#include "weft/device/device.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

constexpr Tunable small_macros[] = {
    {"A", 4, {1, 2, 4, 8}, "a"},
    {"B", 16, {4, 8, 16, 32, 64}, "b"},
};
constexpr TunableKernel small_kernel{"small", small_macros};

// 16^4 combinations; A + B > 20 does not suit the device.
constexpr LegalValues to_sixteen{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
std::string too_much(std::span<const std::size_t> values, const DeviceLimits&) {
  return values[0] + values[1] > 20 ? "A + B is more than 20" : "";
}
constexpr Tunable large_macros[] = {
    {"A", 8, to_sixteen, "a"},
    {"B", 8, to_sixteen, "b"},
    {"C", 8, to_sixteen, "c"},
    {"D", 8, to_sixteen, "d"},
};
constexpr TunableKernel large_kernel{"large", large_macros, too_much};

// Work whose runs take the time that a function says, on a clock of its own.
class MadeUpWork : public TuneWork {
 public:
  std::function<double(const TuneValues&)> seconds = [](const TuneValues&) { return 1.0; };
  std::function<std::string(const TuneValues&)> wrong = [](const TuneValues&) {
    return std::string();
  };
  std::vector<TuneValues> checked;
  std::set<TuneValues> timed;
  double clock = 0;

  std::string check(const TuneValues& values) override {
    checked.push_back(values);
    return wrong(values);
  }
  double time(const TuneValues& values) override {
    timed.insert(values);
    const double time = seconds(values);
    clock += time;
    return time;
  }
  double now() override { return clock; }
};

TuneOutcome tune(const TunableKernel& kernel, const TuneValues& base, MadeUpWork& work,
                 double budget, std::uint64_t seed = 0, const std::vector<TuneValues>& first = {}) {
  TuneOptions options;
  options.budget = budget;
  options.seed = seed;
  return tune_kernel(kernel, DeviceLimits{}, base, first, work, options);
}

TEST(TuneSearch, ASmallGridIsVisitedWhole) {
  MadeUpWork work;
  work.seconds = [](const TuneValues& values) {
    return values == TuneValues{2, 64} ? 0.5 : 1.0 + 0.01 * static_cast<double>(values[0]);
  };
  const TuneOutcome outcome = tune(small_kernel, {4, 16}, work, 1e6);
  EXPECT_EQ(outcome.legal, 20U);
  EXPECT_EQ(outcome.tried, 20U);
  EXPECT_EQ(work.timed.size(), 20U);
  EXPECT_TRUE(outcome.improved);
  EXPECT_EQ(outcome.best, (TuneValues{2, 64}));
  EXPECT_DOUBLE_EQ(outcome.best_seconds, 0.5);
  EXPECT_DOUBLE_EQ(outcome.base_seconds, 1.04);
}

TEST(TuneSearch, AWrongResultNeverCounts) {
  MadeUpWork work;
  // the fastest computes nonsense, the next one does not build
  work.seconds = [](const TuneValues& values) {
    if (values == TuneValues{1, 4}) return 0.1;
    return values == TuneValues{8, 8} ? 0.5 : 1.0;
  };
  work.wrong = [](const TuneValues& values) -> std::string {
    if (values == TuneValues{1, 4}) return "value 3 is 0, where 1 is expected";
    if (values == TuneValues{1, 8}) fail_runtime("small.cl does not build\nsecond line");
    return {};
  };
  const TuneOutcome outcome = tune(small_kernel, {4, 16}, work, 1e6);
  EXPECT_EQ(outcome.best, (TuneValues{8, 8}));
  EXPECT_EQ(outcome.rejected, 2U);
  EXPECT_FALSE(work.timed.contains({1, 4}));
  EXPECT_FALSE(work.timed.contains({1, 8}));
  const std::set<std::string> told(outcome.rejections.begin(), outcome.rejections.end());
  EXPECT_EQ(told, (std::set<std::string>{"A=1 B=4: value 3 is 0, where 1 is expected",
                                         "A=1 B=8: small.cl does not build"}));
}

TEST(TuneSearch, AWrongBaseIsAnError) {
  MadeUpWork work;
  work.wrong = [](const TuneValues&) { return std::string("value 3 is 0"); };
  expect_error(ErrorKind::runtime, {"small", "A=4 B=16", "value 3 is 0"}, [&] {
    tune(small_kernel, {4, 16}, work, 10);
  });
}

TEST(TuneSearch, AnInterruptionEndsIt) {
  MadeUpWork work;
  work.wrong = [&](const TuneValues&) -> std::string {
    if (work.checked.size() > 3) fail(ErrorKind::interrupted, "interrupted");
    return {};
  };
  expect_error(ErrorKind::interrupted, {"interrupted"}, [&] {
    tune(small_kernel, {4, 16}, work, 1e6);
  });
}

TEST(TuneSearch, TheBudgetHoldsWithinOneCandidate) {
  for (const double budget : {0.0, 1.0, 25.0, 100.0}) {
    SCOPED_TRACE(budget);
    MadeUpWork work;
    work.seconds = [](const TuneValues& values) { return values[0] == 4 ? 1.0 : 0.9; };
    tune(large_kernel, {8, 8, 8, 8}, work, budget);
    // a candidate is warmed up and takes three turns beside the base; so does the last comparison
    EXPECT_LE(work.clock, budget + 1 + 7 + 6);
  }
}

TEST(TuneSearch, NoiseDoesNotReplaceTheBase) {
  MadeUpWork work;
  // every run takes a time of its own, between 0.9 and 1.1, whatever the values
  std::size_t runs = 0;
  work.seconds = [&](const TuneValues&) {
    ++runs;
    return 1.0 + 0.1 * std::sin(static_cast<double>(runs * runs));
  };
  const TuneOutcome outcome = tune(small_kernel, {4, 16}, work, 1e6);
  EXPECT_TRUE(outcome.compared);
  EXPECT_FALSE(outcome.improved);
  EXPECT_EQ(outcome.best, (TuneValues{4, 16}));
  EXPECT_GT(outcome.noise, 0.01);
}

TEST(TuneSearch, AGainBelowOnePercentIsNone) {
  MadeUpWork work;
  work.seconds = [](const TuneValues& values) { return values == TuneValues{2, 64} ? 0.995 : 1.0; };
  const TuneOutcome outcome = tune(small_kernel, {4, 16}, work, 1e6);
  EXPECT_FALSE(outcome.improved);
  EXPECT_EQ(outcome.best, (TuneValues{4, 16}));
}

TEST(TuneSearch, ClimbsInALargeGrid) {
  MadeUpWork work;
  work.seconds = [](const TuneValues& values) {
    double distance = 0;
    const double goal[] = {3, 14, 12, 5};
    for (std::size_t i = 0; i < 4; ++i) {
      distance += std::abs(static_cast<double>(values[i]) - goal[i]);
    }
    return 1e-3 * (10 + distance);
  };
  const TuneOutcome outcome = tune(large_kernel, {8, 8, 8, 8}, work, 30);
  EXPECT_EQ(outcome.best, (TuneValues{3, 14, 12, 5}));
  EXPECT_LT(outcome.tried, outcome.legal);
  // none that does not suit the device
  for (const TuneValues& values : work.checked) EXPECT_LE(values[0] + values[1], 20U);
}

TEST(TuneSearch, TheSameSeedVisitsTheSameCandidates) {
  const auto visited = [](std::uint64_t seed) {
    MadeUpWork work;
    tune(large_kernel, {8, 8, 8, 8}, work, 300, seed);
    return work.checked;
  };
  const std::vector<TuneValues> first = visited(1);
  EXPECT_GT(first.size(), 20U);
  EXPECT_EQ(first, visited(1));
  EXPECT_NE(first, visited(2));
}

TEST(TuneSearch, FormerValuesAreLookedAtFirst) {
  MadeUpWork work;
  work.seconds = [](const TuneValues& values) { return values[3] == 1 ? 0.5 : 1.0; };
  const TuneOutcome outcome = tune(large_kernel, {8, 8, 8, 8}, work, 10, 0, {{1, 1, 1, 1}});
  ASSERT_GE(work.checked.size(), 2U);
  EXPECT_EQ(work.checked[1], (TuneValues{1, 1, 1, 1}));
  EXPECT_EQ(outcome.best, (TuneValues{1, 1, 1, 1}));
}

}  // namespace
}  // namespace weft::test
