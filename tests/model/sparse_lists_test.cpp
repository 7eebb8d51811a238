// Lists of sparse models from codes, and what shorter lists cost.
#include "weft/model/sparse_lists.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/model/sparse_lengths.hpp"

namespace weft::test {
namespace {

std::vector<std::uint32_t> indices_of(const IndexTensor& tensor) {
  std::vector<std::uint32_t> indices;
  for (std::size_t i = 0; i < tensor.size(); ++i) {
    indices.push_back(static_cast<std::uint32_t>(tensor[i]));
  }
  return indices;
}

TEST(SparseLists, AreSortedAndFilledUpWithTheLowestUnusedAtoms) {
  // padding of any index; the second signal has one term, the third none
  const CodeLists codes{3, {4, 1, 3, 1, 0, 0, 2, 2, 2}, {1, 2, 3, 7, 0, 0, 0, 0, 0}};
  const SparseLists lists = sparse_lists(codes, 5);
  EXPECT_EQ(lists.length, 3U);
  EXPECT_EQ(indices_of(lists.atoms), (std::vector<std::uint32_t>{1, 3, 4, 0, 1, 2, 0, 1, 2}));
  EXPECT_EQ(lists.coefficients, (std::vector<float>{2, 3, 1, 0, 7, 0, 0, 0, 0}));
}

TEST(SparseLists, AreNoLongerThanThereAreAtoms) {
  const CodeLists codes{3, {1, 0, 0, 0, 0, 0}, {5, 0, 0, 6, 0, 0}};
  const SparseLists lists = sparse_lists(codes, 2);
  EXPECT_EQ(lists.length, 2U);
  EXPECT_EQ(indices_of(lists.atoms), (std::vector<std::uint32_t>{0, 1, 0, 1}));
  EXPECT_EQ(lists.coefficients, (std::vector<float>{0, 5, 6, 0}));
}

TEST(SparseLists, WeightsAreNormsOfRowsAndUnusedAtomsAreDropped) {
  CodeLists codes{2, {3, 1, 3, 0}, {3, -2, 4, 0}};
  std::vector<double> weights = atom_weights(codes, 5);
  EXPECT_EQ(weights, (std::vector<double>{0, 2, 0, 5, 0}));
  EXPECT_EQ(drop_unused(codes, weights), (std::vector<std::uint32_t>{1, 3}));
  EXPECT_EQ(weights, (std::vector<double>{2, 5}));
  EXPECT_EQ(codes.indices, (std::vector<std::uint32_t>{1, 0, 1, 0}));
}

// An atom of weight zero in the middle of a list leaves no trace.
TEST(SparseLists, PaddingOfDroppedAtomsIsNumberedAnew) {
  CodeLists codes{2, {2, 0, 3, 2}, {1, 0, 1, 1}};
  std::vector<double> weights = atom_weights(codes, 4);
  drop_unused(codes, weights);
  const SparseLists lists = sparse_lists(codes, weights.size());
  EXPECT_EQ(indices_of(lists.atoms), (std::vector<std::uint32_t>{0, 1, 0, 1}));
  EXPECT_EQ(lists.coefficients, (std::vector<float>{1, 0, 1, 1}));
}

TEST(TruncationErrors, AreThoseOfTheTermsLeftOutOfAnOrthonormalDictionary) {
  const std::vector<float> D{1, 0, 0, 0, 1, 0, 0, 0, 1};
  const std::vector<float> Y{3, 4, 1, 0, 2, 0};
  const CodeLists codes{3, {1, 0, 2, 1, 0, 0}, {4, 3, 1, 2, 0, 0}};
  const std::vector<double> errors = truncation_errors(3, Y, D, codes);
  const std::vector<double> expected{26 + 4, 9 + 1, 1, 0};
  EXPECT_TRUE(all_near(errors, expected, 1e-12));
}

// Two correlated atoms: the least squares solution of both leaves nothing, the first alone its
// distance.
TEST(TruncationErrors, SolveLeastSquares) {
  const std::vector<float> D{1, 0, 0.6f, 0.8f};
  const std::vector<float> Y{2, 1};
  const std::vector<double> errors = truncation_errors(2, Y, D, {2, {1, 0}, {1.25, 1.25}});
  EXPECT_TRUE(all_near(errors, std::vector<double>{5, 1, 0}, 1e-6));
}

TEST(TruncationErrors, OfSampledSignalsAreScaledToAll) {
  const std::size_t signals = 300;
  const std::vector<float> Y = random_floats(signals * 4, 3, -1, 1);
  const std::vector<float> D = random_floats(8 * 4, 4, -1, 1);
  CodeLists codes{2, {}, {}};
  Random random(5);
  for (std::size_t s = 0; s < signals; ++s) {
    const auto first = static_cast<std::uint32_t>(random.index(4));
    codes.indices.insert(codes.indices.end(), {first, first + 4});
    codes.coefficients.insert(codes.coefficients.end(), {1.0, 1.0});
  }
  const std::vector<double> all = truncation_errors(4, Y, D, codes);
  const std::vector<double> some = truncation_errors(4, Y, D, codes, 100);
  EXPECT_NEAR(some[0], all[0], 1e-9 * all[0]);
  for (std::size_t m = 1; m < 3; ++m) {
    EXPECT_LE(all[m], all[m - 1]);
    // a third of evenly spread uniform signals: their mean strays by 1 / sqrt(100) of its spread
    EXPECT_NEAR(some[m] / all[m], 1.0, 0.3);
  }
}

std::size_t bytes_of(std::size_t k1, std::size_t k2) {
  return 100 + 10 * k1 + 20 * k2;
}

// (3, 1) takes as many bytes as (1, 2) and leaves more, (3, 2) more than (1, 3).
TEST(SparseLengths, AreThoseThatNoOtherBeats) {
  const std::vector<double> views{9, 5, 4, 3.5};
  const std::vector<double> texels{20, 10, 4, 1};
  const std::vector<SparseLengthChoice> best = best_lengths(views, texels, bytes_of);
  const std::vector<std::array<double, 4>> expected{
      {1, 1, 15, 130}, {2, 1, 14, 140}, {1, 2, 9, 150},  {2, 2, 8, 160},
      {1, 3, 6, 170},  {2, 3, 5, 180},  {3, 3, 4.5, 190}};
  ASSERT_EQ(best.size(), expected.size());
  for (std::size_t i = 0; i < best.size(); ++i) {
    EXPECT_EQ(best[i].view_terms, expected[i][0]) << i;
    EXPECT_EQ(best[i].texel_terms, expected[i][1]) << i;
    EXPECT_EQ(best[i].squares, expected[i][2]) << i;
    EXPECT_EQ(best[i].bytes, expected[i][3]) << i;
  }
}

// Longer lists that leave as much are none of them.
TEST(SparseLengths, OfErrorsThatDoNotFall) {
  const std::vector<SparseLengthChoice> best =
      best_lengths(std::vector<double>{1, 1, 1}, std::vector<double>{2, 1, 1}, bytes_of);
  ASSERT_EQ(best.size(), 1U);
  EXPECT_EQ(best[0].bytes, 130U);
  EXPECT_TRUE(best_lengths(std::vector<double>{1}, std::vector<double>{2, 1}, bytes_of).empty());
}

}  // namespace
}  // namespace weft::test
