// Orthogonal matching pursuit on the device, in both forms and both families, against what defines
// it (pursuits.hpp). Sizes straddle the padding of atoms (64, or 256 in groups), vectors (16) and
// chunks (4096 signals of few atoms).
#include "weft/ops/batch_omp.hpp"

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
#include "ops/pursuits.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/process.hpp"
#include "support/shared_device.hpp"
#include "weft/reference/batch_omp.hpp"

namespace weft::test {
namespace {

using ops::OmpForm;
using ops::OmpOptions;

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
