// Every path of the truncated SVD, in every arithmetic, on matrices that are hard in one way each,
// against a reference in long double and the bounds of docs/numerics.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "numerics/bounds.hpp"
#include "numerics/errors.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/truncated_svd.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/syrk.hpp"
#include "weft/ops/tsqr.hpp"

namespace weft::numerics {
namespace {

using test::shared_device;

constexpr std::array methods{SvdMethod::gram, SvdMethod::randomized, SvdMethod::qr};

std::vector<Arithmetic> arithmetics() {
  if (shared_device().limits().has_fp64) return {Arithmetic::f32, Arithmetic::f64};
  return {Arithmetic::f32};
}

struct Problem {
  Matrix matrix;
  ReferenceSvd truth;
};

Problem problem_of(const Case& what, Arithmetic arithmetic) {
  Problem problem;
  problem.matrix = what.make(arithmetic);
  problem.truth = reference_svd(problem.matrix, what.period);
  return problem;
}

class Numerics : public testing::TestWithParam<std::string> {};

TEST_P(Numerics, ErrorsAreWithinTheirBounds) {
  // a tenth of the rows of the table's: the factors of those take a gigabyte
  const Case what = GetParam() == "long-sums" ? long_sums(1'000'000) : find_case(GetParam());
  for (const Arithmetic arithmetic : arithmetics()) {
    const Problem problem = problem_of(what, arithmetic);
    for (const SvdMethod method : methods) {
      SCOPED_TRACE(testing::Message() << name_of(method) << ", " << name_of(arithmetic));
      const Computed computed =
          factorise(shared_device(), problem.matrix, what.rank, method, arithmetic);
      EXPECT_LE(computed.rank, what.rank);
      EXPECT_TRUE(std::is_sorted(computed.values.rbegin(), computed.values.rend()));
      const Errors errors = compare(what, problem.matrix, problem.truth, computed);
      const Bounds bounds = bounds_of(what, problem.matrix, problem.truth, method, arithmetic);
      EXPECT_LE(errors.value, bounds.value);
      EXPECT_LE(errors.reconstruction, bounds.reconstruction);
      if (what.leading > 0) {
        EXPECT_LE(errors.subspace, bounds.subspace);
      }
    }
  }
}

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const Case& what : cases()) all.push_back(what.name);
  return all;
}

std::string test_name(const testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Cases, Numerics, testing::ValuesIn(names()), test_name);

Errors graded_errors(const Problem& problem, SvdMethod method, Arithmetic arithmetic) {
  const Case& what = find_case("graded");
  return compare(what, problem.matrix, problem.truth,
                 factorise(shared_device(), problem.matrix, what.rank, method, arithmetic));
}

// The smallest singular value that is found, beside the first: those of qr reach the roundoff,
// those of gram its root, since X^T X holds their squares.
TEST(GradedSpectrum, QrResolvesAllDigitsAndGramHalf) {
  const Case& what = find_case("graded");
  for (const Arithmetic arithmetic : arithmetics()) {
    SCOPED_TRACE(name_of(arithmetic));
    const Problem problem = problem_of(what, arithmetic);
    EXPECT_LE(graded_errors(problem, SvdMethod::qr, arithmetic).resolved,
              arithmetic == Arithmetic::f32 ? 1.001e-6 : 1.001e-12);

    const double gram = graded_errors(problem, SvdMethod::gram, arithmetic).resolved;
    const Bounds bounds =
        bounds_of(what, problem.matrix, problem.truth, SvdMethod::gram, arithmetic);
    // as much as is promised, by one step of the spectrum
    EXPECT_LE(gram, bounds.resolved * std::pow(10.0, 0.25));
    // and not more than the root of the roundoff, to within the rounding that G may be spared
    EXPECT_GE(gram, std::sqrt(roundoff(arithmetic)) / 10);
  }
}

// In f32 the inner products of the basis are in double, and lose nothing that float holds.
TEST(GradedSpectrum, RandomizedResolvesFloat) {
  const Problem problem = problem_of(find_case("graded"), Arithmetic::f32);
  EXPECT_LE(graded_errors(problem, SvdMethod::randomized, Arithmetic::f32).resolved, 1.001e-6);
}

TEST(Factorisation, TheSameBitsOnEveryRun) {
  const Matrix matrix = find_case("graded").make(Arithmetic::f32);
  for (const SvdMethod method : methods) {
    const Computed first = factorise(shared_device(), matrix, 49, method, Arithmetic::f32);
    const Computed second = factorise(shared_device(), matrix, 49, method, Arithmetic::f32);
    EXPECT_EQ(first.values, second.values);
    EXPECT_EQ(first.V, second.V);
    EXPECT_EQ(first.XV, second.XV);
  }
}

// 10^7 terms in the sums of the first pass, on the device: of X^T X and of R.
TEST(Factorisation, SumsOfTenMillionTerms) {
  Device& device = shared_device();
  const std::size_t block = 1 << 16;
  const std::size_t times = 160;
  const double rows = static_cast<double>(block * times);
  const std::size_t width = ops::panel_width(device);
  std::vector<float> panel(block * width, 0.0f);
  for (std::size_t i = 0; i < block; ++i) panel[i * width] = 0.1f;
  Buffer X(device, panel.size() * sizeof(float), "rows");
  device.write(X, std::span<const float>(panel));
  Buffer G(device, sizeof(float), "Gram matrix");
  ops::Tsqr tsqr(device, 1, Arithmetic::f32);
  for (std::size_t i = 0; i < times; ++i) {
    ops::syrk_packed(device, 1, block, 1.0, X, i == 0 ? 0.0 : 1.0, G, 1);
    tsqr.add(X, block);
  }
  std::vector<float> g(1);
  device.read(G, std::span<float>(g));
  const double expected = double{0.1f} * double{0.1f} * rows;
  // equal terms are rounded alike: all signs may be the worst
  const double terms = static_cast<double>(ops::syrk_terms(device, 1, block) + times);
  EXPECT_NEAR(double{g[0]}, expected, test::gamma(terms, 0x1p-24) * expected);
  // 16 blocks in a chain, 3 merges, 16 + 5 in the levels above, each with sums of 64 + 8 + 14 terms
  EXPECT_NEAR(std::abs(tsqr.R()[0]), std::sqrt(expected),
              test::gamma(40 * 86, 0x1p-24) * std::sqrt(expected));
}

// NaN and infinities never reach a factorisation: the first one is named.
TEST(Factorisation, WhatIsNotFiniteIsRefusedByItsIndex) {
  const BtfShape shape{3, 4, 5, 6, 3};
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), -std::numeric_limits<double>::infinity()}) {
    std::vector<double> values = test::random_values(shape.values(), 1);
    // (2, 1, 4, 3, 2), and a later one
    values[(((2 * 4 + 1) * 5 + 4) * 6 + 3) * 3 + 2] = bad;
    values.back() = bad;
    for (const SvdMethod method : methods) {
      for (const Arithmetic arithmetic : arithmetics()) {
        const auto source = test::source_of(shape, DType::f32, values);
        SvdOptions options;
        options.method = method;
        options.arithmetic = arithmetic;
        options.rank = 4;
        Job job;
        test::expect_error(ErrorKind::input,
                           {"first at view 2, light 1, row 4, column 3, channel 2"},
                           [&] { truncated_svd(shared_device(), *source, options, job); });
      }
    }
  }
}

}  // namespace
}  // namespace weft::numerics
