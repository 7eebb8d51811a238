// Orthogonal matching pursuit at its limits: signals and atoms of every magnitude, dictionaries
// that are singular, nearly singular or zero, and signals of which little is left, or nothing.
#include <fmt/core.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "ops/matrices.hpp"
#include "ops/pursuits.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/reference/batch_omp.hpp"

namespace weft::test {
namespace {

using ops::OmpForm;
using ops::OmpOptions;

// Signals of which one is zero, one an atom, one tiny, one huge, one NaN and one infinite.
TEST(BatchOmp, SignalsOfEveryMagnitude) {
  Problem problem = random_problem(40, 21, 12, 13);
  const auto signal = [&](std::size_t s) {
    return std::span<float>(problem.Y.data() + s * problem.dimension, problem.dimension);
  };
  std::ranges::fill(signal(0), 0.0f);
  std::ranges::copy(std::span<const float>(problem.D.data(), problem.dimension), signal(1).begin());
  for (const auto& [s, scale] : std::vector<std::pair<std::size_t, float>>{
           {2, 1e-30f}, {3, 1e30f}, {4, 1e-15f}, {5, 1e15f}, {6, 1e-32f}, {7, 3e31f}}) {
    for (float& value : signal(s)) value *= scale;
  }
  for (std::size_t n = 0; n < problem.atoms; n += 3) {
    const float scale = n % 2 == 0 ? 1e-6f : 1e6f;
    for (std::size_t i = 0; i < problem.dimension; ++i) {
      problem.D[n * problem.dimension + i] *= scale;
    }
  }
  expect_every_way(problem, {5, 0});

  signal(8)[20] = unused;
  signal(9)[3] = std::numeric_limits<float>::infinity();
  for (const OmpOptions& options : every_way({5, 0})) {
    SCOPED_TRACE(text_of(options));
    const Codes codes = code(problem, options);
    const reference::SparseCodes expected = reference::batch_omp(
        problem.atoms, problem.dimension, widened(problem.D), widened(problem.Y), options.target);
    for (const std::size_t s : Sizes{0, 8, 9}) {
      EXPECT_EQ(codes.counts[s], 0U);
      EXPECT_EQ(expected.counts[s], 0U);
      EXPECT_EQ(std::isnan(codes.residuals[s]), s != 0);
      EXPECT_EQ(std::isnan(expected.residuals[s]), s != 0);
    }
    EXPECT_EQ(codes.counts[1], 1U);
    EXPECT_EQ(expected.counts[1], 1U);
    EXPECT_EQ(codes.counts[10], 5U);
    for (const float x : codes.coefficients) EXPECT_TRUE(std::isfinite(x));
  }
}

// Subnormal signals, whose correlations have few digits where they are not scaled first, and
// signals whose correlations no float holds.
TEST(BatchOmp, SignalsAtTheEndsOfFloats) {
  const std::size_t k = 3;
  for (const auto& [atoms, signals] :
       std::vector<std::pair<float, float>>{{1e-12f, 1e-43f}, {1e20f, 3e38f}}) {
    Problem problem = random_problem(30, 24, 6, 35);
    for (float& value : problem.D) value *= atoms;
    for (float& value : problem.Y) value *= signals;
    const reference::SparseCodes expected = reference::batch_omp(
        problem.atoms, problem.dimension, widened(problem.D), widened(problem.Y), {k, 0});
    for (const OmpOptions& options : every_way({k, 0})) {
      SCOPED_TRACE(text_of(options));
      const Codes codes = code(problem, options);
      EXPECT_EQ(codes.indices, expected.indices);
      for (std::size_t s = 0; s < problem.signals(); ++s) {
        double sum = 0;
        for (std::size_t j = 0; j < k; ++j) sum += std::abs(expected.coefficients[s * k + j]);
        for (std::size_t j = 0; j < k; ++j) {
          // three of random atoms are far from dependent
          EXPECT_NEAR(codes.coefficients[s * k + j], expected.coefficients[s * k + j],
                      4 * gamma(terms_of(problem, k), float_roundoff) * sum);
        }
      }
    }
  }
}

TEST(BatchOmp, DictionariesOfEveryMagnitude) {
  for (const auto& [atoms, signals] : std::vector<std::pair<float, float>>{
           {1e-30f, 1e-30f}, {1e30f, 1e30f}, {1e30f, 1e-5f}, {1e-30f, 1e5f}}) {
    Problem problem = random_problem(30, 14, 4, 15);
    for (float& value : problem.D) value *= atoms;
    for (float& value : problem.Y) value *= signals;
    expect_every_way(problem, {4, 0});
  }
}

// A coefficient that no float holds is the largest float.
TEST(BatchOmp, CoefficientsStayFinite) {
  Problem problem{2, 2, {1e-30f, 0, 0, 1}, {1e30f, 1e29f}};
  for (const OmpOptions& options : every_way({2, 0})) {
    SCOPED_TRACE(text_of(options));
    const Codes codes = code(problem, options);
    EXPECT_EQ(codes.counts[0], 2U);
    EXPECT_EQ(codes.coefficients[0], std::numeric_limits<float>::max());
    EXPECT_NEAR(codes.coefficients[1], 1e29f, 1e23f);
  }
}

// Zero, duplicate, opposite and nearly collinear atoms, and some with a NaN or infinity.
TEST(BatchOmp, DegenerateDictionaries) {
  Problem problem = random_problem(60, 12, 20, 17);
  const auto atom = [&](std::size_t n) {
    return std::span<float>(problem.D.data() + n * problem.dimension, problem.dimension);
  };
  std::ranges::fill(atom(0), 0.0f);
  std::ranges::copy(atom(2), atom(1).begin());
  for (std::size_t i = 0; i < problem.dimension; ++i) {
    atom(3)[i] = -2 * atom(2)[i];
    atom(5)[i] = atom(4)[i] * (1 + 1e-6f * static_cast<float>(i));
    atom(7)[i] = atom(6)[i] * (1 + 2e-3f * static_cast<float>(i));
    atom(10)[i] = atom(8)[i] + atom(9)[i];
  }
  atom(11)[4] = unused;
  atom(12)[0] = -std::numeric_limits<float>::infinity();
  // a signal of each of those, exactly
  for (std::size_t n = 0; n < 11; ++n) {
    std::ranges::copy(atom(n),
                      problem.Y.begin() + static_cast<std::ptrdiff_t>(n * problem.dimension));
  }
  // in the reference, atoms with NaN are zero
  for (const std::size_t k : Sizes{1, 6, 12, 14, 70}) {
    for (const OmpOptions& options : every_way({k, 0})) {
      const Codes codes = code(problem, options);
      for (std::size_t i = 0; i < codes.indices.size(); ++i) {
        if (codes.coefficients[i] == 0) continue;
        EXPECT_NE(codes.indices[i], 0U);
        EXPECT_NE(codes.indices[i], 11U);
        EXPECT_NE(codes.indices[i], 12U);
      }
    }
    expect_every_way(problem, {k, 0});
  }
}

// Two atoms at a small angle, and signals that need both: coefficients are large and of opposite
// signs, and what they leave is rounding of them.
TEST(BatchOmp, NearlyCollinearAtoms) {
  const std::size_t dimension = 12;
  for (const float angle : {3e-2f, 3e-3f, 3e-4f}) {
    Problem problem{2, dimension, std::vector<float>(2 * dimension, 0.0f), {}};
    problem.D[0] = 0.6f;
    problem.D[1] = 0.8f;
    problem.D[dimension] = 0.6f - 0.8f * angle;
    problem.D[dimension + 1] = 0.8f + 0.6f * angle;
    for (const float side : {0.5f, -0.3f, 0.1f}) {
      problem.Y.resize(problem.Y.size() + dimension, 0.0f);
      problem.Y[problem.Y.size() - dimension] = 0.6f - 0.8f * side;
      problem.Y[problem.Y.size() - dimension + 1] = 0.8f + 0.6f * side;
    }
    for (const OmpOptions& options : every_way({2, 0})) {
      SCOPED_TRACE(text_of(options) + fmt::format(", angle {}", angle));
      const Codes codes = code(problem, options);
      for (std::size_t s = 0; s < problem.signals(); ++s) {
        ASSERT_EQ(codes.counts[s], 2U);
        double sum = 0;
        std::vector<double> rest(dimension);
        for (std::size_t i = 0; i < dimension; ++i) rest[i] = problem.Y[s * dimension + i];
        for (std::size_t j = 0; j < 2; ++j) {
          const double x = codes.coefficients[2 * s + j];
          const std::size_t n = codes.indices[2 * s + j];
          sum += std::abs(x);
          for (std::size_t i = 0; i < dimension; ++i) rest[i] -= x * problem.D[n * dimension + i];
        }
        EXPECT_LE(norm(rest), gamma(terms_of(problem, 2), float_roundoff) * (1 + sum));
      }
      if (options.form == OmpForm::gram && angle < 1e-2f) {
        EXPECT_EQ(codes.recoded, 3U);
      }
    }
  }
}

// An atom within 2^-12 of the span of those before is passed over for one that explains less.
TEST(BatchOmp, PassesDependentAtomsOver) {
  const std::size_t dimension = 5;
  Problem problem{3, dimension, std::vector<float>(3 * dimension, 0.0f), {1.0f, 0.5f, 0, 0, 0}};
  problem.D[0] = 1;
  problem.D[dimension] = 1;
  problem.D[dimension + 1] = 1e-4f;
  problem.D[2 * dimension + 2] = 1;
  problem.D[2 * dimension + 1] = 1e-5f;
  // the second explains more at first, by 5e-5
  for (const std::size_t k : Sizes{2, 3}) {
    for (const OmpOptions& options : every_way({k, 0})) {
      SCOPED_TRACE(text_of(options));
      const Codes codes = code(problem, options);
      const reference::SparseCodes expected = reference::batch_omp(
          3, dimension, widened(problem.D), widened(problem.Y), options.target);
      EXPECT_EQ(codes.counts[0], 2U);
      EXPECT_EQ(codes.indices[0], 1U);
      EXPECT_EQ(codes.indices[1], 2U);
      EXPECT_EQ(codes.indices, expected.indices);
    }
  }
}

// Every atom the same, or nearly: one is chosen, the lowest.
TEST(BatchOmp, OneAtomManyTimes) {
  Problem problem = random_problem(1, 9, 4, 19);
  problem.atoms = 300;
  const std::vector<float> one = problem.D;
  while (problem.D.size() < problem.atoms * problem.dimension) {
    problem.D.insert(problem.D.end(), one.begin(), one.end());
  }
  for (const OmpOptions& options : every_way({4, 0})) {
    SCOPED_TRACE(text_of(options));
    const Codes codes = code(problem, options);
    const reference::SparseCodes expected = reference::batch_omp(
        problem.atoms, problem.dimension, widened(problem.D), widened(problem.Y), options.target);
    for (std::size_t s = 0; s < problem.signals(); ++s) {
      EXPECT_EQ(codes.counts[s], 1U);
      EXPECT_EQ(expected.counts[s], 1U);
      for (std::size_t j = 0; j < 4; ++j) {
        EXPECT_EQ(codes.indices[s * 4 + j], j);
        EXPECT_EQ(expected.indices[s * 4 + j], j);
      }
    }
  }
}

// Signals that the dictionary's span does not hold, and more atoms wanted than it has rank.
TEST(BatchOmp, RankDeficientDictionaries) {
  const std::size_t rank = 6;
  Problem problem{50, 24, {}, random_floats(24 * 30, 21, -1.0, 1.0)};
  const std::vector<double> values(rank, 1.0);
  for (const double x : matrix_with_singular_values(problem.atoms, problem.dimension, values, 22)) {
    problem.D.push_back(static_cast<float>(x));
  }
  for (const OmpOptions& options : every_way({10, 0})) {
    const Codes codes = code(problem, options);
    for (const std::uint32_t count : codes.counts) EXPECT_LE(count, rank);
    expect_pursuits(problem, options);
  }
}

// Targets above and below what the inner products can tell.
TEST(BatchOmp, EndsFarBelowTheSignal) {
  Problem problem = random_problem(64, 12, 60, 23);
  for (const double residual : {1e-1, 2e-3, 1e-3, 1e-4, 1e-5}) {
    expect_every_way(problem, {12, residual});
  }
}

// Residuals to be reached are in the unit of signals that are scaled before they are squared.
TEST(BatchOmp, EndsAtResidualsOfEveryMagnitude) {
  for (const float scale : {1e-15f, 1e15f}) {
    Problem problem = random_problem(40, 12, 30, 39);
    for (float& value : problem.Y) value *= scale;
    expect_every_way(problem, {8, 0.8 * double{scale}});
  }
}

// A residual to be reached that rounding of |y|^2 hides: whether one atom does is told right.
TEST(BatchOmp, EndsAtResidualsBelowTheRoundingOfSquares) {
  const std::size_t dimension = 8;
  const double target = 1.2e-3;
  const std::vector<double> basis = random_orthonormal(dimension, dimension, 37);
  Problem problem{3, dimension, {}, {}};
  for (std::size_t i = 0; i < 3 * dimension; ++i) {
    problem.D.push_back(static_cast<float>(basis[i]));
  }
  Random random(38);
  std::vector<std::uint32_t> counts;
  for (int s = 0; s < 100; ++s) {
    // 0.5 to 2 per cent above or below, where rounding of |y|^2 makes 4
    const bool above = s % 2 == 0;
    const double size = random.uniform(1.0, 1.15);
    const double rest = target * (1 + (above ? 1 : -1) * random.uniform(0.005, 0.02));
    for (std::size_t i = 0; i < dimension; ++i) {
      problem.Y.push_back(static_cast<float>(size * basis[i] + rest * basis[dimension + i]));
    }
    counts.push_back(above ? 2 : 1);
  }
  for (const OmpOptions& options : every_way({2, target})) {
    SCOPED_TRACE(text_of(options));
    EXPECT_EQ(code(problem, options).counts, counts);
  }
}

// Without a single atom that can be chosen, all of every signal is left.
TEST(BatchOmp, DictionaryOfZeros) {
  Problem problem = random_problem(70, 9, 5, 31);
  std::ranges::fill(problem.D, 0.0f);
  for (const OmpOptions& options : every_way({3, 0})) {
    EXPECT_EQ(expect_pursuits(problem, options), problem.signals());
    const Codes codes = code(problem, options);
    EXPECT_EQ(codes.counts, std::vector<std::uint32_t>(problem.signals(), 0));
  }
}

// What is left of a signal is large and orthogonal to all atoms, which do not depend on each other:
// none of them is chosen for a coefficient of zero.
TEST(BatchOmp, EndsWhereNoAtomImproves) {
  Problem problem{3, 5, {2, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 3, 0, 0}, {}};
  problem.Y = {5, 0, 0, 1, 0, 0, 4, 0, 0, -2, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1};
  for (const std::uint32_t k : {2U, 3U}) {
    for (const OmpOptions& options : every_way({k, 0})) {
      EXPECT_EQ(expect_pursuits(problem, options), problem.signals());
      EXPECT_EQ(code(problem, options).counts, (std::vector<std::uint32_t>{1, 1, 0, k}));
    }
  }
}

}  // namespace
}  // namespace weft::test
