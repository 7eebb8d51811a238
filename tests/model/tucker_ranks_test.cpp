// The choice of ranks of Tucker models: what is lost is what the core loses, goals are met to the
// byte, and ranks in equal proportion are the largest that fit.
#include "weft/model/tucker_ranks.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"

namespace weft::test {
namespace {

double squares(const std::vector<float>& values) {
  double sum = 0;
  for (const float value : values) sum += double{value} * double{value};
  return sum;
}

// Values that fall along every mode, more slowly along later ones.
std::vector<float> falling_core(const std::vector<std::size_t>& sizes, std::uint64_t seed) {
  std::size_t count = 1;
  for (const std::size_t size : sizes) count *= size;
  std::vector<float> core = random_floats(count, seed, 0.5, 1.0);
  for (std::size_t i = 0; i < count; ++i) {
    double exponent = 0;
    for (std::size_t n = sizes.size(), rest = i; n-- > 0; rest /= sizes[n]) {
      exponent += static_cast<double>(rest % sizes[n]) / static_cast<double>(2 + n);
    }
    core[i] *= static_cast<float>(std::exp(-exponent));
  }
  return core;
}

TEST(RankChoice, LosesWhatTheCoreLoses) {
  const std::vector<std::size_t> sizes{9, 12, 3, 10};
  const std::vector<float> core = falling_core(sizes, 3);
  const double all = squares(core);
  const TuckerBytes bytes{2, 4, sizes, {1, 1, 1, 1}};
  const double slack = gamma(static_cast<double>(4 * core.size()), 0x1p-53) * all;
  std::size_t cut_modes = 0;
  const auto expect_told = [&](const RankChoice& choice) {
    EXPECT_NEAR(choice.lost, all - squares(leading_part(core, sizes, choice.ranks)), slack);
    for (std::size_t n = 0; n < sizes.size(); ++n) cut_modes += choice.ranks[n] < sizes[n] ? 1 : 0;
  };
  double before = bytes.of(sizes) + 1;
  for (const double part : {1e-4, 1e-3, 1e-2, 0.1, 0.5}) {
    SCOPED_TRACE(part);
    const RankChoice choice = cut_ranks(core, sizes, bytes, {part * all, 0});
    expect_told(choice);
    EXPECT_LE(choice.lost, part * all + slack);
    EXPECT_LT(bytes.of(choice.ranks), before);
    before = bytes.of(choice.ranks);
  }
  double lost = 0;
  for (const double part : {0.5, 0.2, 0.1, 0.05}) {
    SCOPED_TRACE(part);
    const double most = part * bytes.of(sizes);
    const RankChoice choice = cut_ranks(core, sizes, bytes, {0, most});
    expect_told(choice);
    EXPECT_LE(bytes.of(choice.ranks), most);
    EXPECT_GT(choice.lost, lost);
    lost = choice.lost;
  }
  EXPECT_GE(cut_modes, 20U);
}

// Losses and bytes that are exactly those allowed.
TEST(RankChoice, GoalsAreMetToTheLast) {
  const std::vector<std::size_t> sizes{6, 6};
  std::vector<float> core(36, 0.0f);
  core[0] = 2;
  core[7] = 1;
  const TuckerBytes bytes{4, 0, sizes, {1, 1}};
  const std::vector<std::size_t> both{2, 2};
  EXPECT_EQ(cut_ranks(core, sizes, bytes, {1, 0}).ranks, (std::vector<std::size_t>{1, 1}));
  EXPECT_EQ(cut_ranks(core, sizes, bytes, {0.999, 0}).ranks, both);
  EXPECT_EQ(cut_ranks(core, sizes, bytes, {0, bytes.of(both)}).ranks, both);
  const RankChoice less = cut_ranks(core, sizes, bytes, {0, bytes.of(both) - 1});
  EXPECT_LT(bytes.of(less.ranks), bytes.of(both));
  EXPECT_EQ(less.lost, 1);
  // ranks that are in no equal proportion
  std::vector<float> row(36, 0.0f);
  row[0] = row[1] = 2;
  row[3] = 1;
  const std::vector<std::size_t> short_row{1, 2};
  EXPECT_EQ(cut_ranks(row, sizes, bytes, {1, 0}).ranks, short_row);
  EXPECT_EQ(cut_ranks(row, sizes, bytes, {0, bytes.of(short_row)}).ranks, short_row);
}

TEST(RankChoice, EqualProportionsAreTheLargestThatFit) {
  const std::vector<std::size_t> sizes{40, 20, 30};
  const TuckerBytes bytes{2, 4, sizes, {1, 1, 0}};
  const std::vector<std::size_t> half{20, 10, 30};
  EXPECT_EQ(equal_proportion(bytes, bytes.of(half)), half);
  EXPECT_EQ(equal_proportion(bytes, bytes.of(half) - 1), (std::vector<std::size_t>{19, 10, 30}));
  EXPECT_EQ(equal_proportion(bytes, bytes.of(sizes)), sizes);
  EXPECT_EQ(equal_proportion(bytes, 1), (std::vector<std::size_t>{1, 1, 1}));
}

TEST(RankChoice, TailsAndRanksOfSpectra) {
  const std::vector<double> spectrum{5, 2, 0.5, -1e-9};
  EXPECT_EQ(tail(spectrum, 0), 7.5);
  EXPECT_EQ(tail(spectrum, 2), 0.5);
  EXPECT_EQ(tail(spectrum, 3), 0);
  EXPECT_EQ(rank_within(spectrum, 0), 3U);
  EXPECT_EQ(rank_within(spectrum, 2.5), 1U);
}

}  // namespace
}  // namespace weft::test
