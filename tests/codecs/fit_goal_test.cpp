// Goals of the tensor codecs, read from their option.
#include "weft/codecs/fit_goal.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"
#include "support/generators.hpp"

namespace weft::test {
namespace {

FitGoal goal_of(const char* text) {
  return fit_goal({{"target", text}}, make_info({2, 3, 4, 5, 3}, DType::f16));
}

TEST(FitGoal, ReadsEveryKind) {
  EXPECT_FALSE(fit_goal({}, make_info({1, 1, 1, 1, 1})));
  EXPECT_FALSE(goal_of(""));
  const FitGoal relative = goal_of("rel=2e-2");
  EXPECT_EQ(relative.kind, FitGoal::Kind::relative);
  EXPECT_EQ(relative.relative, 0.02);
  EXPECT_EQ(relative.text, "rel=2e-2");
  EXPECT_EQ(goal_of("size=3KiB").kind, FitGoal::Kind::size);
  EXPECT_EQ(goal_of("size=3KiB").bytes, 3072U);
  EXPECT_EQ(goal_of("ratio=4").bytes, std::size_t{2 * 3 * 4 * 5 * 3 * 2 / 4});
}

TEST(FitGoal, RefusesOthersAndNamesThem) {
  for (const char* text : {"rel", "rel=", "rel=0", "rel=1", "rel=-1e-3", "rel=nan", "rel=inf",
                           "rel=0.1x", "size=", "size=0", "size=big", "size=-1", "ratio=0.5",
                           "ratio=", "ratio=nan", "psnr=40", "=3", "rel 0.1"}) {
    expect_error(ErrorKind::input, {"--target"}, [&] { goal_of(text); });
  }
}

}  // namespace
}  // namespace weft::test
