#include "ops/pursuits.hpp"

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include "ops/matrices.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/reference/batch_omp.hpp"
#include "weft/reference/factorise.hpp"

namespace weft::test {
namespace {

using ops::OmpForm;
using ops::OmpOptions;

constexpr std::uint32_t untouched = 77;

double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
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

}  // namespace

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

double norm(std::span<const double> a) {
  double largest = 0;
  for (const double x : a) largest = std::max(largest, std::abs(x));
  double sum = 0;
  for (const double x : a) sum += largest > 0 ? (x / largest) * (x / largest) : 0.0;
  return largest * std::sqrt(sum);
}

double terms_of(const Problem& problem, std::size_t k) {
  return static_cast<double>(problem.dimension + 8 * k + 8);
}

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

}  // namespace weft::test
