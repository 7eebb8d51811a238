// Truncated SVDs of streamed matrices, in all three ways and both arithmetics, against the exact
// SVD: by rank, by tolerance, by energy, and at the extremes.
#include "weft/codecs/streamed_svd.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/svd_goal.hpp"
#include "weft/error.hpp"
#include "weft/ops/reals.hpp"
#include "weft/ops/syrk.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/gemm.hpp"

namespace weft::test {
namespace {

// Factors on the host, in the units of the matrix.
struct Factors {
  std::size_t rank = 0;
  std::vector<double> values;
  std::vector<double> V;   // m x k
  std::vector<double> XV;  // K x k
  double residual = 0;     // as reported
  std::size_t passes = 0;
};

double frobenius(std::span<const double> values) {
  double largest = 0;
  for (const double value : values) largest = std::max(largest, std::abs(value));
  if (largest == 0) return 0;
  double sum = 0;
  for (const double value : values) sum += (value / largest) * (value / largest);
  return largest * std::sqrt(sum);
}

class StreamedSvds : public testing::TestWithParam<std::tuple<SvdMethod, Arithmetic>> {
 protected:
  SvdMethod method() const { return std::get<0>(GetParam()); }
  Arithmetic arithmetic() const { return std::get<1>(GetParam()); }
  double unit() const { return arithmetic() == Arithmetic::f32 ? float_roundoff : double_roundoff; }

  // The values as the stream holds them.
  std::vector<double> held(std::vector<double> A) const {
    if (arithmetic() == Arithmetic::f32) {
      for (double& value : A) value = static_cast<double>(static_cast<float>(value));
    }
    return A;
  }

  Factors factorise(std::size_t K, std::size_t m, const std::vector<double>& A, SvdTarget target,
                    std::size_t granule = 37) const {
    Device& device = shared_device();
    target.method = method();
    const std::vector<float> floats(A.begin(), A.end());
    const auto stream =
        arithmetic() == Arithmetic::f32
            ? std::make_unique<MatrixPanels>(device, K, m, std::span<const float>(floats), granule)
            : std::make_unique<MatrixPanels>(device, K, m, std::span<const double>(A), granule);
    Job job;
    const StreamedSvd svd = streamed_svd(device, *stream, target, job);
    const double unscale = 1 / stream->scale();
    Factors factors{svd.rank,
                    svd.values,
                    std::vector<double>(m * svd.rank),
                    std::vector<double>(K * svd.rank),
                    svd.residual * unscale,
                    svd.passes};
    for (double& value : factors.values) value *= unscale;
    if (svd.rank > 0) {
      ops::read_reals(device, svd.V, arithmetic(), m, svd.rank, svd.leading, 1.0,
                      std::span(factors.V));
      ops::read_reals(device, svd.XV, arithmetic(), K, svd.rank, svd.leading, unscale,
                      std::span(factors.XV));
    }
    return factors;
  }

  // |A - XV V^T|, in double.
  static double error(std::size_t K, std::size_t m, const std::vector<double>& A,
                      const Factors& factors) {
    std::vector<double> rest = A;
    std::vector<double> transposed(factors.V.size());
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t j = 0; j < factors.rank; ++j) {
        transposed[j * m + i] = factors.V[i * factors.rank + j];
      }
    }
    if (factors.rank > 0) {
      reference::gemm(K, m, factors.rank, -1.0, factors.XV, transposed, 1.0, rest);
    }
    return frobenius(rest);
  }

  // What the products of the way leave beside the best: R is that of A + E with |E| <= c u |A|, a
  // Gram matrix that of A^T A + E with |E| <= gamma |A|^2, of which a projection loses up to
  // sqrt(2 k |E|); projecting and turning round as many products as there are columns.
  double allowance(std::size_t K, std::size_t m, std::size_t k, double norm) const {
    const double products = 2 * gamma(static_cast<double>(m + 2 * k + 64), unit()) * norm;
    if (method() == SvdMethod::qr) return products;
    if (method() == SvdMethod::randomized) {
      // energies are those of a Gram matrix in double
      return products + std::sqrt(2 * static_cast<double>(k) *
                                  gamma(static_cast<double>(K), double_roundoff)) *
                            norm;
    }
    const double terms = static_cast<double>(ops::syrk_terms(shared_device(), m, K, arithmetic())) +
                         static_cast<double>(K / 37 + 1);
    return products + std::sqrt(2 * static_cast<double>(k) * gamma(terms, unit())) * norm;
  }

  // Columns of V are orthonormal to rounding, and the values descend.
  void expect_basis(std::size_t m, const Factors& factors) const {
    const std::size_t k = factors.rank;
    for (std::size_t i = 0; i < k; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        double product = 0;
        for (std::size_t r = 0; r < m; ++r) product += factors.V[r * k + i] * factors.V[r * k + j];
        EXPECT_NEAR(product, i == j ? 1.0 : 0.0, 8 * gamma(static_cast<double>(m + 2 * k), unit()))
            << i << ", " << j;
      }
      if (i > 0) {
        EXPECT_LE(factors.values[i], factors.values[i - 1]);
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Ways, StreamedSvds,
                         testing::Combine(testing::Values(SvdMethod::gram, SvdMethod::randomized,
                                                          SvdMethod::qr),
                                          testing::Values(Arithmetic::f32, Arithmetic::f64)),
                         [](const auto& info) {
                           return std::string(name_of(std::get<0>(info.param))) + "_" +
                                  std::string(name_of(std::get<1>(info.param)));
                         });

template <typename Value>
std::vector<double> spectrum(std::size_t count, const Value& value) {
  std::vector<double> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = value(static_cast<double>(i));
  return values;
}

double tail(const std::vector<double>& values, std::size_t k) {
  return frobenius(std::span(values).subspan(std::min(k, values.size())));
}

TEST_P(StreamedSvds, ErrorIsNearTheBestOfItsRank) {
  const auto spectra = {spectrum(60, [](double i) { return 1 / (i + 1); }),
                        spectrum(60, [](double i) { return std::pow(0.8, i); }),
                        spectrum(60, [](double i) { return std::pow(0.3, i); }),
                        spectrum(60, [](double) { return 1.0; }),
                        spectrum(60, [](double i) { return std::pow(10.0, -std::floor(i / 7)); })};
  std::size_t which = 0;
  for (const std::vector<double>& values : spectra) {
    for (const auto& [K, m] : {std::pair<std::size_t, std::size_t>{310, 60}, {60, 310}}) {
      const std::vector<double> A = held(matrix_with_singular_values(K, m, values, 3));
      const std::vector<double> sigma = reference::thin_svd(K, m, A).values;
      const double norm = frobenius(A);
      for (const std::size_t rank : Sizes{1, 9, 25}) {
        SCOPED_TRACE(testing::Message()
                     << "spectrum " << which << ", " << K << " x " << m << ", rank " << rank);
        SvdTarget target;
        target.rank = rank;
        const Factors factors = factorise(K, m, A, target);
        const double best = tail(sigma, rank);
        const double allowed = allowance(K, m, rank, norm);
        EXPECT_LE(error(K, m, A, factors), 1.01 * best + allowed);
        EXPECT_LE(factors.rank, rank);
        expect_basis(m, factors);
        for (std::size_t j = 0; j < factors.rank; ++j) {
          // no Ritz value exceeds the singular value; a block iteration may stop short of the last
          EXPECT_LE(factors.values[j], sigma[j] + allowed) << j;
          if (method() != SvdMethod::randomized) {
            EXPECT_GE(factors.values[j], sigma[j] - allowed) << j;
          }
        }
      }
    }
    ++which;
  }
}

// A goal between the errors of two ranks is met by the smaller number of components that can.
TEST_P(StreamedSvds, GoalsAreMetByTheFewestComponents) {
  const auto spectra = {spectrum(90, [](double i) { return 1 / (i + 1); }),
                        spectrum(90, [](double i) { return std::pow(0.85, i); }),
                        spectrum(90, [](double i) { return i < 30 ? 1.0 : 1e-3; })};
  std::size_t which = 0;
  for (const std::vector<double>& values : spectra) {
    for (const auto& [K, m] : {std::pair<std::size_t, std::size_t>{400, 90}, {90, 400}}) {
      const std::vector<double> A = held(matrix_with_singular_values(K, m, values, 5));
      const std::vector<double> sigma = reference::thin_svd(K, m, A).values;
      const double norm = frobenius(A);
      for (const std::size_t k : Sizes{3, 30, 60}) {
        // far above what a Gram matrix loses
        const double wanted = std::sqrt(tail(sigma, k) * tail(sigma, k - 1));
        if (wanted < 2e-2 * norm && method() == SvdMethod::gram) continue;
        if (wanted < 1e-4 * norm) continue;
        for (const bool by_energy : {false, true}) {
          SCOPED_TRACE(testing::Message() << "spectrum " << which << ", " << K << " x " << m << ", "
                                          << k << (by_energy ? ", energy" : ", tolerance"));
          SvdTarget target;
          if (by_energy) {
            target.energy = 1 - std::pow(wanted / norm, 2);
          } else {
            // relative to a longer tensor, of which A is without its mean
            target.constant_squares = 0;
            target.tolerance = wanted / norm;
          }
          const Factors factors = factorise(K, m, A, target);
          EXPECT_LE(error(K, m, A, factors), wanted * (1 + 1e-3));
          // no smaller number could have met it by more than 1 %
          std::size_t fewest = 0;
          while (tail(sigma, fewest) * 1.01 > wanted) ++fewest;
          EXPECT_LE(factors.rank, fewest);
          EXPECT_GE(factors.rank, k - (tail(sigma, k - 1) < 1.001 * wanted ? 1 : 0));
          EXPECT_NEAR(factors.residual, error(K, m, A, factors), 0.02 * wanted);
        }
      }
    }
    ++which;
  }
}

// A tolerance refers to the data with its mean.
TEST_P(StreamedSvds, ToleranceIsRelativeToTheWhole) {
  const std::size_t K = 120, m = 40;
  const std::vector<double> A = held(
      matrix_with_singular_values(K, m, spectrum(40, [](double i) { return 1 / (i + 1); }), 5));
  SvdTarget target;
  target.tolerance = 0.1;
  const std::size_t alone = factorise(K, m, A, target).rank;
  // A scaled to lie below 1 has |X|^2 of the order of 100
  target.constant_squares = 1e4;
  EXPECT_LT(factorise(K, m, A, target).rank, alone);
}

TEST_P(StreamedSvds, GoalsOutOfReachAreUnmet) {
  const std::size_t K = 200, m = 80;
  const std::vector<double> A = held(
      matrix_with_singular_values(K, m, spectrum(80, [](double i) { return 1 / (i + 1); }), 6));
  for (const bool by_rank : {true, false}) {
    SvdTarget target;
    target.tolerance = 1e-2;
    (by_rank ? target.rank : target.most_columns) = 20;
    try {
      factorise(K, m, A, target);
      ADD_FAILURE() << "20 components were enough";
    } catch (const Error& failure) {
      EXPECT_EQ(failure.kind(), ErrorKind::unmet_goal);
      const std::string message = failure.what();
      EXPECT_NE(message.find("--tolerance 0.01"), std::string::npos) << message;
      EXPECT_NE(message.find(by_rank ? "--rank" : "--memory"), std::string::npos) << message;
      // how many it takes: no more than there are
      const std::size_t at = message.find("allows: ");
      EXPECT_EQ(at == std::string::npos, by_rank) << message;
      if (by_rank || at == std::string::npos) continue;
      const unsigned long needed = std::stoul(message.substr(at + 8));
      EXPECT_GT(needed, 20U) << message;
      EXPECT_LE(needed, 80U) << message;
    }
  }
  // the same caps where they are enough
  for (const bool by_rank : {true, false}) {
    SvdTarget target;
    (by_rank ? target.rank : target.most_columns) = 20;
    target.tolerance = 0.3;
    if (by_rank || method() != SvdMethod::randomized) {
      EXPECT_LE(factorise(K, m, A, target).rank, 20U);
    }
  }
  SvdTarget beyond;
  beyond.tolerance = 1e-30;
  EXPECT_THROW(factorise(K, m, A, beyond), Error);
}

// Exactly rank-k data comes back to rounding, whatever rank is asked, and noise is not kept.
TEST_P(StreamedSvds, LowRankIsRecoveredAndNoiseIsDropped) {
  for (const auto& [K, m] : {std::pair<std::size_t, std::size_t>{150, 50}, {50, 150}}) {
    const std::vector<double> A =
        held(matrix_with_singular_values(K, m, std::vector<double>{1, 0.5, 0.25, 0.1}, 7));
    const double norm = frobenius(A);
    for (const std::size_t rank : Sizes{4, 12, 50, 1000}) {
      SCOPED_TRACE(testing::Message() << K << " x " << m << ", rank " << rank);
      SvdTarget target;
      target.rank = rank;
      const Factors factors = factorise(K, m, A, target);
      // Rounding the input to float is of full rank, as long as sqrt(K m) units of its values.
      EXPECT_LE(error(K, m, A, factors),
                2 * gamma(static_cast<double>(m + 2 * factors.rank + 64), unit()) * norm);
      EXPECT_GE(factors.rank, 4U);
      if (arithmetic() == Arithmetic::f64) {
        EXPECT_LE(factors.rank, 6U);
      }
    }
  }
}

TEST_P(StreamedSvds, Extremes) {
  for (const auto& [K, m] : {std::pair<std::size_t, std::size_t>{1, 1},
                             {1, 30},
                             {30, 1},
                             {25, 24},
                             {24, 25},
                             {2, 3},
                             {37, 12},
                             {38, 13}}) {
    SCOPED_TRACE(testing::Message() << K << " x " << m);
    SvdTarget target;
    target.rank = 7;
    EXPECT_EQ(factorise(K, m, std::vector<double>(K * m, 0.0), target).rank, 0U);
    const Factors constant = factorise(K, m, std::vector<double>(K * m, 0.5), target);
    EXPECT_EQ(constant.rank, 1U);
    const std::vector<double> A = held(random_values(K * m, 8, -1.0, 1.0));
    target.rank = 100;
    const Factors whole = factorise(K, m, A, target);
    EXPECT_LE(error(K, m, A, whole),
              2 * gamma(static_cast<double>(3 * m + 64), unit()) * frobenius(A));
  }
}

TEST_P(StreamedSvds, MagnitudesFarFromOne) {
  const std::size_t K = 90, m = 31;
  const std::vector<double> one =
      matrix_with_singular_values(K, m, spectrum(31, [](double i) { return std::pow(0.5, i); }), 9);
  const std::vector<double> magnitudes = arithmetic() == Arithmetic::f32
                                             ? std::vector<double>{1e-42, 1e-30, 1e30}
                                             : std::vector<double>{1e-310, 1e-200, 1e-30, 1e200};
  for (const double magnitude : magnitudes) {
    std::vector<double> A = one;
    for (double& value : A) value *= magnitude;
    A = held(A);
    // What is left of subnormal data has absolute steps.
    const double step = arithmetic() == Arithmetic::f32 ? 0x1p-149 : 0x0.0000000000001p-1022;
    const std::vector<double> sigma = reference::thin_svd(K, m, one).values;
    SvdTarget target;
    target.rank = 5;
    const Factors factors = factorise(K, m, A, target);
    EXPECT_LE(error(K, m, A, factors) / magnitude,
              1.01 * tail(sigma, 5) + allowance(K, m, 5, frobenius(one)) +
                  static_cast<double>(K + m) * step / magnitude)
        << magnitude;
    EXPECT_EQ(factors.rank, 5U);
  }
}

TEST_P(StreamedSvds, TheSameBitsTwice) {
  const std::size_t K = 130, m = 70;
  const std::vector<double> A = held(random_values(K * m, 10, -1.0, 1.0));
  SvdTarget target;
  target.rank = 11;
  const Factors first = factorise(K, m, A, target);
  const Factors second = factorise(K, m, A, target);
  EXPECT_TRUE(all_equal(first.V, second.V));
  EXPECT_TRUE(all_equal(first.XV, second.XV));
  // what memory allows changes nothing, as long as it is enough
  const std::vector<double> B = held(matrix_with_singular_values(
      400, 320, spectrum(320, [](double i) { return 1 / (i + 1); }), 10));
  target.rank = 0;
  target.energy = 0.9;
  const Factors free = factorise(400, 320, B, target);
  target.most_columns = 300;
  const Factors bounded = factorise(400, 320, B, target);
  EXPECT_TRUE(all_equal(free.V, bounded.V));
}

TEST_P(StreamedSvds, LongSidesAreForIterationsOnly) {
  if (method() == SvdMethod::randomized) return;
  const std::vector<double> A(4097, 1.0);
  SvdTarget target;
  target.rank = 1;
  try {
    factorise(1, 4097, A, target);
    ADD_FAILURE() << "4097 columns were taken";
  } catch (const Error& failure) {
    EXPECT_EQ(failure.kind(), ErrorKind::input);
    EXPECT_NE(std::string(failure.what()).find("4097"), std::string::npos) << failure.what();
  }
}

// A plan bounds what buffers there are at the peak.
TEST_P(StreamedSvds, PlansHold) {
  for (const auto& [K, m] : {std::pair<std::size_t, std::size_t>{3000, 200}, {200, 3000}}) {
    const std::vector<double> A = held(random_values(K * m, 12, -1.0, 1.0));
    // Ranks whose blocks fill little of a panel, and more; 0: a goal.
    for (const std::size_t rank : Sizes{8, 20, 0}) {
      const bool goal = rank == 0;
      Device device("auto");
      SvdTarget target;
      target.method = method();
      if (goal) {
        target.energy = 0.5;
        target.most_columns = 200;
      } else {
        target.rank = rank;
      }
      if (method() != SvdMethod::randomized && m > 1000) continue;  // minutes of host work
      const std::vector<float> floats(A.begin(), A.end());
      const auto stream =
          arithmetic() == Arithmetic::f32
              ? std::make_unique<MatrixPanels>(device, K, m, std::span<const float>(floats), 64)
              : std::make_unique<MatrixPanels>(device, K, m, std::span<const double>(A), 64);
      Job job;
      const StreamedSvd svd = streamed_svd(device, *stream, target, job);
      const std::size_t own = 3 * 64 * (m + 24) * size_of(arithmetic());  // the stream's
      EXPECT_LE(device.peak_allocated(),
                own + plan_streamed_svd(device, {K, m, 64, arithmetic()}, target).total())
          << K << " x " << m << ", rank " << rank;
    }
  }
}

TEST(SvdGoals, SmallestRankCountsWhatIsLeft) {
  const std::vector<double> values{4, 2, 1};
  EXPECT_EQ(smallest_rank(values, 0, 0.5), 3U);
  EXPECT_EQ(smallest_rank(values, 0, 1), 2U);
  EXPECT_EQ(smallest_rank(values, 0, 5), 1U);
  EXPECT_EQ(smallest_rank(values, 0, 21), 0U);
  EXPECT_EQ(smallest_rank(values, 0.75, 0.5), 4U);
  EXPECT_EQ(smallest_rank({}, 0, 0), 0U);
}

}  // namespace
}  // namespace weft::test
