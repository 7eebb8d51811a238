// Orthogonal matching pursuit on the device, in both forms and both families, against what defines
// it: every atom is the best one of its step, coefficients are least squares, and pursuits end
// where they should. Sizes straddle the padding of atoms (64, or 256 in groups), vectors (16) and
// chunks (4096 signals of few atoms).
#include "weft/ops/batch_omp.hpp"

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "ops/matrices.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/process.hpp"
#include "support/shared_device.hpp"
#include "weft/reference/batch_omp.hpp"
#include "weft/reference/factorise.hpp"

namespace weft::test {
namespace {

using ops::OmpForm;
using ops::OmpOptions;

struct Problem {
  std::size_t atoms = 1;
  std::size_t dimension = 1;
  std::vector<float> D;
  std::vector<float> Y;

  std::size_t signals() const { return Y.size() / dimension; }
};

struct Codes {
  std::vector<std::uint32_t> indices;
  std::vector<float> coefficients;
  std::vector<std::uint32_t> counts;
  std::vector<float> residuals;
  std::size_t recoded = 0;
};

// All ways of computing it.
std::vector<OmpOptions> every_way(const OmpTarget& target) {
  std::vector<OmpOptions> ways;
  for (const OmpForm form : {OmpForm::gram, OmpForm::residual}) {
    for (const ops::Family family : {ops::Family::panels, ops::Family::tiles}) {
      ways.push_back({target, form, family, ops::Family::panels});
    }
  }
  return ways;
}

std::string text_of(const OmpOptions& options) {
  return fmt::format("k {}, residual {}, {}, {}", options.target.sparsity, options.target.residual,
                     options.form == OmpForm::gram ? "gram" : "residual",
                     options.family == ops::Family::panels ? "panels" : "tiles");
}

constexpr std::uint32_t untouched = 77;

Codes code(const Problem& problem, const OmpOptions& options) {
  Device& device = shared_device();
  const std::size_t signals = problem.signals();
  const std::size_t k = options.target.sparsity;
  const std::size_t first = 3;  // entries before the first stay as they are
  const std::size_t leading = problem.dimension + 2;
  GuardedBuffer D(
      device,
      std::span<const float>(with_leading(problem.D, problem.atoms, problem.dimension, leading, 5)),
      "D");
  GuardedBuffer Y(
      device,
      std::span<const float>(with_leading(problem.Y, signals, problem.dimension, leading, 1)), "Y");
  const std::vector<std::uint32_t> before((first + signals) * k, untouched);
  GuardedBuffer indices(device, std::span<const std::uint32_t>(before), "indices");
  GuardedBuffer coefficients(device, before.size() * sizeof(float), "coefficients");
  GuardedBuffer counts(device, (first + signals) * sizeof(std::uint32_t), "counts");
  GuardedBuffer residuals(device, (first + signals) * sizeof(float), "residuals");
  ops::BatchOmp omp(device, problem.atoms, problem.dimension, options);
  omp.set_dictionary({D.buffer(), leading, 5});
  omp.code(signals, {Y.buffer(), leading, 1},
           {indices.buffer(), coefficients.buffer(), counts.buffer(), &residuals.buffer(), first});
  Codes codes;
  codes.indices = indices.values<std::uint32_t>();
  codes.coefficients = coefficients.values<float>();
  codes.counts = counts.values<std::uint32_t>();
  codes.residuals = residuals.values<float>();
  codes.recoded = omp.recoded();
  for (GuardedBuffer* buffer : {&D, &Y, &indices, &coefficients, &counts, &residuals}) {
    EXPECT_TRUE(buffer->intact());
  }
  for (std::size_t i = 0; i < first * k; ++i) EXPECT_EQ(codes.indices[i], untouched);
  const auto drop = [](auto& values, std::size_t count) {
    values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count));
  };
  drop(codes.indices, first * k);
  drop(codes.coefficients, first * k);
  drop(codes.counts, first);
  drop(codes.residuals, first);
  return codes;
}

double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}
double norm(std::span<const double> a) {
  double largest = 0;
  for (const double x : a) largest = std::max(largest, std::abs(x));
  double sum = 0;
  for (const double x : a) sum += largest > 0 ? (x / largest) * (x / largest) : 0.0;
  return largest * std::sqrt(sum);
}

// Unit atoms in double, and their norms; zero for atoms that can't be chosen.
struct Units {
  std::size_t dimension;
  std::vector<double> rows;
  std::vector<double> norms;

  explicit Units(const Problem& problem)
      : dimension(problem.dimension), rows(widened(problem.D)), norms(problem.atoms) {
    for (std::size_t n = 0; n < problem.atoms; ++n) {
      const std::span<double> row(rows.data() + n * dimension, dimension);
      norms[n] = norm(row);
      if (!std::isfinite(norms[n])) norms[n] = 0;
      for (double& x : row) x = norms[n] > 0 ? x / norms[n] : 0.0;
    }
  }
  std::span<const double> operator[](std::size_t n) const {
    return {rows.data() + n * dimension, dimension};
  }
};

// What a code of one signal must be. `terms`: roundings that its arithmetic sums up in a value;
// `u`: its unit roundoff. Errors of inner products reach coefficients and correlations multiplied
// by the inverse of the smallest singular value of the chosen unit atoms.
template <typename Real>
testing::AssertionResult is_pursuit(const Units& units, std::span<const double> y,
                                    const OmpTarget& target, std::uint32_t count,
                                    std::span<const std::uint32_t> indices,
                                    std::span<const Real> coefficients, double residual,
                                    double terms, double u) {
  const std::size_t k = target.sparsity;
  const std::size_t atoms = units.norms.size();
  const std::size_t n = y.size();
  const double size = norm(y);
  if (count > k) return testing::AssertionFailure() << count << " atoms";
  // entries past the count, and no atom twice
  std::set<std::uint32_t> seen;
  for (std::size_t j = 0; j < k; ++j) {
    if (indices[j] >= atoms) return testing::AssertionFailure() << "index " << indices[j];
    if (!std::isfinite(static_cast<double>(coefficients[j]))) {
      return testing::AssertionFailure() << "coefficient " << coefficients[j];
    }
    if (j >= count && coefficients[j] != 0) {
      return testing::AssertionFailure() << "coefficient " << coefficients[j] << " past the count";
    }
    if (j < atoms && !seen.insert(indices[j]).second) {
      return testing::AssertionFailure() << "atom " << indices[j] << " twice";
    }
  }
  // the chosen atoms' smallest singular value, and the size of coefficients
  double smallest = 1;
  double sum = size;
  if (count > 0) {
    std::vector<double> chosen;
    for (std::size_t j = 0; j < count; ++j) {
      const auto unit = units[indices[j]];
      chosen.insert(chosen.end(), unit.begin(), unit.end());
      sum += std::abs(static_cast<double>(coefficients[j])) * units.norms[indices[j]];
    }
    const reference::ThinSvd svd = reference::thin_svd(count, n, chosen);
    smallest = std::min(1.0, svd.values.back());
  }
  const double tolerance = gamma(terms, u) * sum / smallest;
  // step by step
  std::vector<double> r(y.begin(), y.end());
  std::vector<std::vector<double>> basis;
  std::vector<double> distances(atoms, 1.0);  // squared, of atoms from the span
  for (std::size_t t = 0; t <= count; ++t) {
    double best = 0;
    for (std::size_t a = 0; a < atoms; ++a) {
      const double floor = PursuitLimits::least_distance * (1 + 1e-2) + std::sqrt(gamma(terms, u));
      if (units.norms[a] == 0 || distances[a] < floor * floor) continue;
      best = std::max(best, std::abs(dot(units[a], r)));
    }
    const double left = norm(r);
    if (t == count) {
      const bool done = count == std::min({k, atoms, n}) || left <= target.residual + tolerance ||
                        best <= PursuitLimits::smallest_correlation * size + tolerance;
      if (!done) {
        return testing::AssertionFailure() << "ends after " << t << " atoms at residual " << left
                                           << " of " << size << ", with a correlation of " << best;
      }
      break;
    }
    if (left < target.residual - tolerance) {
      return testing::AssertionFailure() << "goes on after atom " << t << " at residual " << left;
    }
    const auto unit = units[indices[t]];
    const double correlation = std::abs(dot(unit, r));
    if (!(correlation >= best - tolerance)) {
      return testing::AssertionFailure()
             << "atom " << t << " has a correlation of " << correlation << " where " << best
             << " is the best of " << size << ", tolerance " << tolerance;
    }
    std::vector<double> q(unit.begin(), unit.end());
    for (int turn = 0; turn < 2; ++turn) {
      for (const auto& other : basis) {
        const double inner = dot(other, q);
        for (std::size_t i = 0; i < n; ++i) q[i] -= inner * other[i];
      }
    }
    const double distance = norm(q);
    if (distance < PursuitLimits::least_distance * 0.99) {
      return testing::AssertionFailure() << "atom " << t << " depends on others: " << distance;
    }
    for (double& x : q) x /= distance;
    const double inner = dot(q, r);
    for (std::size_t i = 0; i < n; ++i) r[i] -= inner * q[i];
    for (std::size_t a = 0; a < atoms; ++a) distances[a] -= std::pow(dot(q, units[a]), 2);
    basis.push_back(std::move(q));
  }
  // least squares, and the residual as told
  std::vector<double> rest(y.begin(), y.end());
  for (std::size_t j = 0; j < count; ++j) {
    const auto unit = units[indices[j]];
    const double x = static_cast<double>(coefficients[j]) * units.norms[indices[j]];
    for (std::size_t i = 0; i < n; ++i) rest[i] -= x * unit[i];
  }
  std::vector<double> excess(n);
  for (std::size_t i = 0; i < n; ++i) excess[i] = rest[i] - r[i];
  if (!(norm(excess) <= tolerance)) {
    return testing::AssertionFailure()
           << "coefficients are " << norm(excess) << " off least squares, tolerance " << tolerance;
  }
  // of what is told, squares are what is summed up
  const double told = residual * residual - dot(r, r);
  if (!(std::abs(told) <= 2 * tolerance * (std::abs(residual) + norm(r)) + tolerance * size)) {
    return testing::AssertionFailure()
           << "residual " << residual << " where it is " << norm(r) << ", tolerance " << tolerance;
  }
  return testing::AssertionSuccess();
}

double terms_of(const Problem& problem, std::size_t k) {
  return static_cast<double>(problem.dimension + 8 * k + 8);
}

// Checks every code; how many have the reference's atoms in its order.
std::size_t expect_pursuits(const Problem& problem, const OmpOptions& options) {
  SCOPED_TRACE(testing::Message() << problem.atoms << " atoms, dimension " << problem.dimension
                                  << ", " << problem.signals() << " signals, " << text_of(options));
  const Codes codes = code(problem, options);
  const std::vector<double> Y = widened(problem.Y);
  const reference::SparseCodes expected =
      reference::batch_omp(problem.atoms, problem.dimension, widened(problem.D), Y, options.target);
  const Units units(problem);
  const std::size_t k = options.target.sparsity;
  const double terms = terms_of(problem, k);
  std::size_t same = 0;
  for (std::size_t s = 0; s < problem.signals(); ++s) {
    const std::span<const double> y(Y.data() + s * problem.dimension, problem.dimension);
    const std::span<const std::uint32_t> indices(codes.indices.data() + s * k, k);
    EXPECT_TRUE(is_pursuit(units, y, options.target, codes.counts[s], indices,
                           std::span<const float>(codes.coefficients.data() + s * k, k),
                           double{codes.residuals[s]}, terms, float_roundoff))
        << "signal " << s;
    const std::span<const std::uint32_t> others(expected.indices.data() + s * k, k);
    EXPECT_TRUE(is_pursuit(units, y, options.target, expected.counts[s], others,
                           std::span<const double>(expected.coefficients.data() + s * k, k),
                           expected.residuals[s], terms, double_roundoff))
        << "signal " << s << " of the reference";
    if (std::ranges::equal(indices, others)) {
      ++same;
      EXPECT_EQ(codes.counts[s], expected.counts[s]) << "signal " << s;
    }
    if (testing::Test::HasFailure()) break;
  }
  return same;
}

void expect_every_way(const Problem& problem, const OmpTarget& target) {
  for (const OmpOptions& options : every_way(target)) expect_pursuits(problem, options);
}

Problem random_problem(std::size_t atoms, std::size_t dimension, std::size_t signals,
                       std::uint64_t seed) {
  return {atoms, dimension, random_floats(atoms * dimension, seed, -1.0, 1.0),
          random_floats(signals * dimension, seed + 1, -1.0, 1.0)};
}

TEST(BatchOmp, SmallInEveryWay) {
  expect_every_way(random_problem(7, 5, 3, 1), {3, 0});
  expect_every_way(random_problem(5, 9, 2, 3), {4, 0.9});
}

TEST(BatchOmp, StraddlesPaddingAndVectors) {
  for (const std::size_t atoms : Sizes{1, 2, 63, 64, 65, 130, 257}) {
    for (const std::size_t dimension : Sizes{1, 3, 15, 16, 17, 33}) {
      expect_every_way(random_problem(atoms, dimension, 5, atoms + dimension), {4, 0});
    }
  }
}

TEST(BatchOmp, StraddlesSparsity) {
  for (const std::size_t k : Sizes{1, 2, 15, 16, 17, 24}) {
    expect_every_way(random_problem(90, 40, 6, 100 + k), {k, 0});
  }
}

TEST(BatchOmp, SupportsAreTheReferences) {
  const Problem problem = random_problem(200, 48, 300, 7);
  for (const OmpOptions& options : every_way({8, 0})) {
    EXPECT_GE(expect_pursuits(problem, options), 297U);
  }
}

TEST(BatchOmp, EndsAtAResidual) {
  Problem problem = random_problem(100, 30, 200, 9);
  for (const double residual : {2.0, 1.0, 0.1}) {
    expect_every_way(problem, {12, residual});
  }
}

// Signals of few atoms of an orthonormal basis and its rotation, whose coherence is small: both
// find exactly those atoms.
TEST(BatchOmp, RecoversSparseSignals) {
  const std::size_t dimension = 64;
  const std::size_t k = 4;
  Random random(11);
  const std::vector<double> basis = random_orthonormal(dimension, dimension, 12);
  Problem problem{2 * dimension, dimension, {}, {}};
  for (std::size_t i = 0; i < dimension * dimension; ++i) {
    problem.D.push_back(i % (dimension + 1) == 0 ? 1.0f : 0.0f);
  }
  for (const double x : basis) problem.D.push_back(static_cast<float>(x));
  std::vector<std::set<std::uint32_t>> supports;
  for (std::size_t s = 0; s < 100; ++s) {
    std::vector<double> y(dimension, 0.0);
    std::set<std::uint32_t> support;
    while (support.size() < k) {
      support.insert(static_cast<std::uint32_t>(random.index(2 * dimension)));
    }
    for (const std::uint32_t n : support) {
      const double x = (random.index(2) == 0 ? -1.0 : 1.0) * random.uniform(1.0, 1.5);
      for (std::size_t i = 0; i < dimension; ++i) y[i] += x * problem.D[n * dimension + i];
    }
    for (const double value : y) problem.Y.push_back(static_cast<float>(value));
    supports.push_back(std::move(support));
  }
  for (const OmpOptions& options : every_way({k, 0})) {
    SCOPED_TRACE(text_of(options));
    const Codes codes = code(problem, options);
    std::size_t recovered = 0;
    for (std::size_t s = 0; s < supports.size(); ++s) {
      const auto first = codes.indices.begin() + static_cast<std::ptrdiff_t>(s * k);
      if (supports[s] == std::set<std::uint32_t>(first, first + k)) {
        ++recovered;
        EXPECT_LE(codes.residuals[s], 1e-5f);
      }
    }
    // A few signals of such coherence are beyond any pursuit: those of the reference.
    const reference::SparseCodes expected = reference::batch_omp(
        problem.atoms, dimension, widened(problem.D), widened(problem.Y), options.target);
    std::size_t recoverable = 0;
    for (std::size_t s = 0; s < supports.size(); ++s) {
      const auto first = expected.indices.begin() + static_cast<std::ptrdiff_t>(s * k);
      recoverable += supports[s] == std::set<std::uint32_t>(first, first + k) ? 1 : 0;
    }
    EXPECT_EQ(recovered, recoverable);
    EXPECT_GE(recovered, 90U);
    // the inner products can't follow residuals of zero
    if (options.form == OmpForm::gram) {
      EXPECT_GE(codes.recoded, recovered);
    }
  }
  // with one atom more than there are, the pursuit ends where nothing is left
  for (const OmpOptions& options : every_way({k + 1, 0})) {
    SCOPED_TRACE(text_of(options));
    const Codes codes = code(problem, options);
    EXPECT_GE(std::ranges::count(codes.counts, k), 90);
    expect_pursuits(problem, options);
  }
}

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
  for (std::size_t n = 0; n < 11; ++n)
    std::ranges::copy(atom(n),
                      problem.Y.begin() + static_cast<std::ptrdiff_t>(n * problem.dimension));
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
TEST(BatchOmp, EndsAtASmallResidual) {
  Problem problem = random_problem(64, 12, 60, 23);
  for (const double residual : {1e-1, 2e-3, 1e-3, 1e-4, 1e-5}) {
    expect_every_way(problem, {12, residual});
  }
}

TEST(BatchOmp, TheSameBitsWhateverTheOthers) {
  Device& device = shared_device();
  // chunks of 4096 and blocks of 65536 signals
  Problem problem = random_problem(20, 3, 70000, 25);
  for (std::size_t i = 0; i < 3 * 500; ++i) problem.Y[i] = problem.D[i % 60];
  for (const OmpOptions& options : every_way({2, 0})) {
    SCOPED_TRACE(text_of(options));
    const bool fast = options.form == OmpForm::gram && options.family == ops::Family::panels;
    const std::size_t signals = fast ? problem.signals() : 5000;
    Buffer D(device, problem.D.size() * sizeof(float), "D");
    Buffer Y(device, problem.Y.size() * sizeof(float), "Y");
    device.write(D, std::span<const float>(problem.D));
    device.write(Y, std::span<const float>(problem.Y));
    ops::BatchOmp omp(device, problem.atoms, problem.dimension, options);
    omp.set_dictionary({D, problem.dimension});
    const auto coded = [&](std::size_t at_once) {
      Buffer indices(device, signals * 2 * sizeof(std::uint32_t), "indices");
      Buffer coefficients(device, signals * 2 * sizeof(float), "coefficients");
      Buffer counts(device, signals * sizeof(std::uint32_t), "counts");
      for (std::size_t s = 0; s < signals; s += at_once) {
        omp.code(std::min(at_once, signals - s), {Y, 3, s * 3},
                 {indices, coefficients, counts, nullptr, s});
      }
      std::vector<std::uint32_t> chosen(signals * 2);
      std::vector<float> values(signals * 2);
      device.read(indices, std::span<std::uint32_t>(chosen));
      device.read(coefficients, std::span<float>(values));
      return std::pair(std::move(chosen), std::move(values));
    };
    const auto whole = coded(signals);
    const auto parts = coded(fast ? 9999 : 777);
    EXPECT_EQ(parts.first, whole.first);
    EXPECT_TRUE(same_bits(parts.second, whole.second));
  }
}

TEST(BatchOmp, FromCorrelations) {
  Device& device = shared_device();
  const Problem problem = random_problem(70, 20, 150, 27);
  const Codes expected = code(problem, {{3, 0}, OmpForm::gram});
  Buffer D(device, problem.D.size() * sizeof(float), "D");
  Buffer Y(device, problem.Y.size() * sizeof(float), "Y");
  device.write(D, std::span<const float>(problem.D));
  device.write(Y, std::span<const float>(problem.Y));
  ops::BatchOmp omp(device, 70, 20, {{3, 0}, OmpForm::gram});
  omp.set_dictionary({D, 20});
  GuardedBuffer C(device, 150 * omp.row_of_correlations() * sizeof(float), "C");
  GuardedBuffer indices(device, 150 * 3 * sizeof(std::uint32_t), "indices");
  GuardedBuffer coefficients(device, 150 * 3 * sizeof(float), "coefficients");
  GuardedBuffer counts(device, 150 * sizeof(std::uint32_t), "counts");
  omp.correlate(150, {Y, 20}, C.buffer());
  omp.code_correlated(150, {Y, 20}, C.buffer(),
                      {indices.buffer(), coefficients.buffer(), counts.buffer()});
  EXPECT_EQ(indices.values<std::uint32_t>(), expected.indices);
  EXPECT_TRUE(same_bits(coefficients.values<float>(), expected.coefficients));
  for (GuardedBuffer* buffer : {&C, &indices, &coefficients, &counts}) {
    EXPECT_TRUE(buffer->intact());
  }
}

// Dictionaries whose inner products are not kept.
TEST(BatchOmp, ManyAtoms) {
  const OmpOptions options{{3, 0}};
  for (const auto& [atoms, signals] : {std::pair(std::size_t{9000}, std::size_t{40}),
                                       std::pair(std::size_t{65536}, std::size_t{17})}) {
    const Problem problem = random_problem(atoms, 10, signals, 29);
    EXPECT_EQ(code(problem, options).recoded, 0U);
    EXPECT_GE(expect_pursuits(problem, options), signals - 1);
  }
  EXPECT_LT(ops::BatchOmp::bytes(shared_device(), 65536, 300, {{16, 0}}), std::size_t{300} << 20);
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
  for (const OmpOptions& options : every_way({3, 0})) {
    EXPECT_EQ(expect_pursuits(problem, options), problem.signals());
    EXPECT_EQ(code(problem, options).counts, (std::vector<std::uint32_t>{1, 1, 0, 3}));
  }
}

// Of what it allocates at once and of what it allocates while it codes.
TEST(BatchOmp, AccountsForItsBuffers) {
  const Problem problem = random_problem(100, 30, 300, 33);
  for (const OmpForm form : {OmpForm::gram, OmpForm::residual}) {
    for (const ops::Family family : {ops::Family::panels, ops::Family::tiles}) {
      Device device("auto");
      const OmpOptions options{{5, 0}, form, family, family};
      Buffer D(device, problem.D.size() * sizeof(float), "D");
      Buffer Y(device, problem.Y.size() * sizeof(float), "Y");
      Buffer indices(device, 300 * 5 * sizeof(std::uint32_t), "indices");
      Buffer coefficients(device, 300 * 5 * sizeof(float), "coefficients");
      Buffer counts(device, 300 * sizeof(std::uint32_t), "counts");
      device.write(D, std::span<const float>(problem.D));
      device.write(Y, std::span<const float>(problem.Y));
      const std::size_t before = device.allocated();
      ops::BatchOmp omp(device, 100, 30, options);
      omp.set_dictionary({D, 30});
      omp.code(300, {Y, 30}, {indices, coefficients, counts});
      EXPECT_LE(device.peak_allocated() - before, ops::BatchOmp::bytes(device, 100, 30, options));
    }
  }
}

// A stop asked for concerns the whole process, so it has its own.
TEST(BatchOmp, DISABLED_InAProcessThatIsStopped) {
  Device& device = shared_device();
  Buffer values(device, 400 * sizeof(float), "values");
  ops::BatchOmp omp(device, 4, 3, {{2, 0}});
  omp.set_dictionary({values, 3});
  request_interrupt();
  expect_error(ErrorKind::interrupted, {"interrupted"}, [&] {
    omp.code(4, {values, 3}, {values, values, values});
  });
}

TEST(BatchOmp, AStopAskedForEndsTheCoding) {
  const ProcessResult result = run_process({"/proc/self/exe", "--gtest_also_run_disabled_tests",
                                            "--gtest_filter=BatchOmp.DISABLED_InAProcess*"});
  EXPECT_EQ(result.status, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("[  PASSED  ] 1 test."), std::string::npos) << result.out;
}

TEST(BatchOmp, RefusesWhatDoesNotFit) {
  Device& device = shared_device();
  const auto make = [&](std::size_t atoms, std::size_t dimension, const OmpTarget& target) {
    ops::BatchOmp(device, atoms, dimension, {target});
  };
  expect_error(ErrorKind::input, {"0 atoms"}, [&] { make(0, 3, {1, 0}); });
  expect_error(ErrorKind::input, {"dimension 0"}, [&] { make(3, 0, {1, 0}); });
  expect_error(ErrorKind::input, {"0 atoms per signal"}, [&] { make(3, 3, {0, 0}); });
  expect_error(ErrorKind::input, {"residual of -1"}, [&] { make(3, 3, {1, -1}); });
  expect_error(ErrorKind::input, {"residual of nan"}, [&] { make(3, 3, {1, std::nan("")}); });
  ops::BatchOmp omp(device, 4, 3, {{2, 0}});
  Buffer small(device, 11 * sizeof(float), "small");
  Buffer large(device, 400 * sizeof(float), "large");
  expect_error(ErrorKind::input, {"matrix D"}, [&] { omp.set_dictionary({small, 3}); });
  omp.set_dictionary({large, 3});
  expect_error(ErrorKind::input, {"matrix Y"}, [&] {
    omp.code(4, {small, 3}, {large, large, large});
  });
  expect_error(ErrorKind::input, {"matrix Y"}, [&] {
    omp.code(1, {large, 2}, {large, large, large});
  });
  expect_error(ErrorKind::input, {"codes of 6 signals"}, [&] {
    omp.code(6, {large, 3}, {small, large, large});
  });
  expect_error(ErrorKind::input, {"codes of 6 signals from 396"}, [&] {
    omp.code(6, {large, 3}, {large, large, large, nullptr, 396});
  });
}

}  // namespace
}  // namespace weft::test
