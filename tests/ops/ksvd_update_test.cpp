// The residuals of codes and the update of the atoms against the reference, with one and with
// several work-items along a row. Sizes straddle a vector (16), what a work-item takes of a row at
// once (64) and a granule of an atom's signals (32).
#include "weft/ops/ksvd_update.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/factorise.hpp"

namespace weft::test {
namespace {

std::vector<double> in_double(const std::vector<float>& values) {
  return {values.begin(), values.end()};
}

double norm(std::span<const double> values) {
  return std::sqrt(std::inner_product(values.begin(), values.end(), values.begin(), 0.0));
}

// Signals that are about sparse in a dictionary.
struct Problem {
  std::size_t signals, n, atoms, k;
  std::vector<float> D, Y, coefficients;
  std::vector<std::uint32_t> indices, counts;

  // Atom `unused` is in no code.
  Problem(std::size_t signals_, std::size_t n_, std::size_t atoms_, std::size_t k_,
          double noise = 0.3, std::size_t unused = ~std::size_t{0})
      : signals(signals_), n(n_), atoms(atoms_), k(std::min(k_, atoms_)) {
    Random random(signals + 100 * n + atoms);
    D = random_floats(atoms * n, 1 + n, -1, 1);
    for (std::size_t j = 0; j < atoms; ++j) {
      double square = 0;
      for (std::size_t i = 0; i < n; ++i) square += std::pow(double{D[j * n + i]}, 2);
      for (std::size_t i = 0; i < n; ++i) {
        D[j * n + i] = static_cast<float>(D[j * n + i] / std::sqrt(square));
      }
    }
    Y = random_floats(signals * n, 3, -noise, noise);
    for (std::size_t i = 0; i < signals; ++i) {
      std::vector<std::uint32_t> order(atoms);
      std::iota(order.begin(), order.end(), 0U);
      for (std::size_t s = 0; s < k; ++s) std::swap(order[s], order[s + random.index(atoms - s)]);
      counts.push_back(static_cast<std::uint32_t>(k));
      for (std::size_t s = 0; s < k; ++s) {
        const bool used = order[s] != unused;
        indices.push_back(order[s]);
        coefficients.push_back(used ? static_cast<float>(random.normal()) : 0.0f);
        // what the signal has of the atom is not quite what its code says
        const double share = 0.9 * coefficients.back();
        for (std::size_t j = 0; j < n; ++j) {
          Y[i * n + j] += static_cast<float>(share * D[order[s] * n + j]);
        }
      }
    }
  }

  std::size_t leading() const { return ops::round_up(n, ops::atom_row_multiple); }
  ops::CodeShape shape() const { return {signals, leading(), atoms, k}; }
  std::vector<float> padded(const std::vector<float>& rows) const {
    std::vector<float> out(rows.size() / n * leading(), 0.0f);
    for (std::size_t i = 0; i < rows.size(); ++i) out[i / n * leading() + i % n] = rows[i];
    return out;
  }
  std::vector<float> unpadded(const std::vector<float>& rows) const {
    std::vector<float> out(rows.size() / leading() * n);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = rows[i / n * leading() + i % n];
    return out;
  }
  // Y - X D, and how large its terms are.
  struct Residual {
    std::vector<double> r, magnitude;
  };
  Residual residual(const std::vector<double>& dictionary, const std::vector<double>& codes) const {
    Residual out{in_double(Y), in_double(Y)};
    for (std::size_t e = 0; e < indices.size(); ++e) {
      for (std::size_t j = 0; j < n; ++j) {
        const double term = codes[e] * dictionary[indices[e] * n + j];
        out.r[e / k * n + j] -= term;
        out.magnitude[e / k * n + j] = std::abs(out.magnitude[e / k * n + j]) + std::abs(term);
      }
    }
    return out;
  }
};

// Codes between guards, and as the operations take them.
struct GuardedCodes {
  GuardedCodes(Device& device, const std::vector<std::uint32_t>& indices_,
               const std::vector<float>& coefficients_, const std::vector<std::uint32_t>& counts_)
      : indices(device, std::span<const std::uint32_t>(indices_), "indices"),
        coefficients(device, std::span<const float>(coefficients_), "coefficients"),
        counts(device, std::span<const std::uint32_t>(counts_), "counts"),
        codes{std::move(indices.buffer()), std::move(coefficients.buffer()),
              std::move(counts.buffer())} {}
  // Gives the buffers back to their guards.
  void done() {
    indices.buffer() = std::move(codes.indices);
    coefficients.buffer() = std::move(codes.coefficients);
    counts.buffer() = std::move(codes.counts);
    EXPECT_TRUE(indices.intact());
    EXPECT_TRUE(coefficients.intact());
    EXPECT_TRUE(counts.intact());
  }
  GuardedBuffer indices, coefficients, counts;
  ops::DeviceCodes codes;
};

void expect_residuals(const Problem& p, std::size_t lanes) {
  SCOPED_TRACE(testing::Message() << p.signals << " signals of " << p.n << ", " << p.atoms
                                  << " atoms, k " << p.k << ", " << lanes << " lanes");
  Device& device = shared_device();
  const GuardedBuffer Y(device, std::span<const float>(p.padded(p.Y)), "Y");
  const GuardedBuffer D(device, std::span<const float>(p.padded(p.D)), "D");
  GuardedBuffer R(device, p.signals * p.leading() * sizeof(float), "R");
  GuardedBuffer errors(device, p.signals * sizeof(float), "errors");
  GuardedCodes codes(device, p.indices, p.coefficients, p.counts);
  ops::code_residuals(device, p.shape(), Y.buffer(), D.buffer(), codes.codes, nullptr, R.buffer(),
                      errors.buffer(), lanes);
  const Problem::Residual expected = p.residual(in_double(p.D), in_double(p.coefficients));
  const double unit = gamma(static_cast<double>(p.k) + 1, float_roundoff);
  EXPECT_TRUE(all_near(p.unpadded(R.values<float>()), expected.r,
                       [&](std::size_t i) { return unit * expected.magnitude[i]; }));
  std::vector<double> squares(p.signals, 0.0), slack(p.signals, 0.0);
  const double length = gamma(static_cast<double>(p.leading() + 2), float_roundoff);
  for (std::size_t i = 0; i < expected.r.size(); ++i) {
    const double off = unit * expected.magnitude[i];
    const double r = std::abs(expected.r[i]) + off;
    squares[i / p.n] += expected.r[i] * expected.r[i];
    slack[i / p.n] += 2 * r * off + length * r * r;
  }
  EXPECT_TRUE(all_near(errors.values<float>(), squares, [&](std::size_t i) { return slack[i]; }));
  codes.done();
  EXPECT_TRUE(R.intact());
  EXPECT_TRUE(errors.intact());
}

TEST(KsvdUpdate, SmallResidualsAreThoseOfTheCodes) {
  for (const std::size_t lanes : {std::size_t{1}, std::size_t{8}}) {
    expect_residuals(Problem(1, 1, 2, 1), lanes);
    expect_residuals(Problem(5, 17, 6, 3), lanes);
  }
}

TEST(KsvdUpdate, ResidualsAreThoseOfTheCodes) {
  for (const std::size_t n : Sizes{15, 16, 63, 64, 65, 129, 300}) {
    expect_residuals(Problem(33, n, 20, 5), 1);
    expect_residuals(Problem(33, n, 20, 5), 8);
  }
}

// Of two codes a signal has the one of the smaller residual by the atoms as they are now.
void expect_kept(std::size_t lanes) {
  SCOPED_TRACE(testing::Message() << lanes << " lanes");
  Device& device = shared_device();
  const Problem p(40, 37, 12, 3, 0.01);
  const GuardedBuffer Y(device, std::span<const float>(p.padded(p.Y)), "Y");
  const GuardedBuffer D(device, std::span<const float>(p.padded(p.D)), "D");
  GuardedBuffer R(device, p.signals * p.leading() * sizeof(float), "R");
  GuardedBuffer errors(device, p.signals * sizeof(float), "errors");
  GuardedCodes before(device, p.indices, p.coefficients, p.counts);
  ops::code_residuals(device, p.shape(), Y.buffer(), D.buffer(), before.codes, nullptr, R.buffer(),
                      errors.buffer(), lanes);
  // Signals 0, 3, 6 ... get a worse code, 1, 4, 7 ... a better one, the others the same. R of
  // signals 2 and 4 claims less than their codes before have: what counts is what the codes have.
  std::vector<float> changed = p.coefficients;
  std::vector<std::uint32_t> counts = p.counts;
  for (std::size_t i = 0; i < p.signals; ++i) {
    for (std::size_t s = 0; s < p.k; ++s) {
      if (i % 3 == 0) changed[i * p.k + s] *= s == 2 ? 0.0f : 2.0f;
      if (i % 3 == 1) changed[i * p.k + s] *= 0.9f;
    }
    if (i % 3 == 0) counts[i] = 2;
  }
  std::vector<float> rows = R.values<float>();
  for (const std::size_t i : Sizes{2, 4}) {
    std::fill_n(rows.begin() + static_cast<std::ptrdiff_t>(i * p.leading()), p.leading(), 0.0f);
  }
  device.write(R.buffer(), std::span<const float>(rows));
  GuardedCodes codes(device, p.indices, changed, counts);
  ops::code_residuals(device, p.shape(), Y.buffer(), D.buffer(), codes.codes, &before.codes,
                      R.buffer(), errors.buffer(), lanes);
  before.done();
  codes.done();
  EXPECT_TRUE(R.intact());
  for (std::size_t i = 0; i < p.signals; ++i) {
    for (std::size_t s = 0; s < p.k && i % 3 == 0; ++s) {
      changed[i * p.k + s] = p.coefficients[i * p.k + s];
    }
  }
  EXPECT_TRUE(all_equal(codes.coefficients.values<float>(), changed));
  EXPECT_TRUE(all_equal(codes.counts.values<std::uint32_t>(), p.counts));
  const Problem::Residual expected = p.residual(in_double(p.D), in_double(changed));
  EXPECT_TRUE(all_near(p.unpadded(R.values<float>()), expected.r, [&](std::size_t i) {
    return gamma(static_cast<double>(p.k) + 1, float_roundoff) * expected.magnitude[i];
  }));
}

TEST(KsvdUpdate, SmallCodesThatAreBetterAreKept) {
  expect_kept(1);
  expect_kept(8);
}

// What an update leaves.
struct Updated {
  std::vector<float> D, coefficients, R;
  std::size_t steps = 0;
};

Updated update_on_device(const Problem& p, KsvdUpdate update, std::size_t lanes) {
  Device& device = shared_device();
  const std::vector<double> left = p.residual(in_double(p.D), in_double(p.coefficients)).r;
  const GuardedBuffer D(device, std::span<const float>(p.padded(p.D)), "D");
  GuardedBuffer after(device, p.atoms * p.leading() * sizeof(float), "updated D");
  GuardedBuffer R(
      device, std::span<const float>(p.padded(std::vector<float>(left.begin(), left.end()))), "R");
  GuardedCodes codes(device, p.indices, p.coefficients, p.counts);
  const ops::AtomUses uses = ops::atom_uses(p.shape(), p.indices, p.coefficients);
  const GuardedBuffer entries(device, std::span<const std::uint32_t>(uses.entries), "entries");
  ops::AtomUpdate operation(device, p.leading(), update, lanes);
  operation.update(p.shape(), uses, entries.buffer(), D.buffer(), after.buffer(),
                   codes.codes.coefficients, R.buffer());
  codes.done();
  EXPECT_TRUE(after.intact());
  EXPECT_TRUE(R.intact());
  // what pads the rows stays zero
  for (const std::vector<float>& rows : {after.values<float>(), R.values<float>()}) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (i % p.leading() < p.n) continue;
      EXPECT_EQ(rows[i], 0.0f) << "padding at " << i;
    }
  }
  return {p.unpadded(after.values<float>()), codes.coefficients.values<float>(),
          p.unpadded(R.values<float>()), operation.steps()};
}

// Both updates against the reference. `gap`: |E^T E d - rho d| / rho at which the power iteration
// ends, by the gap of the leading eigenvalue.
void expect_updated(const Problem& p, KsvdUpdate update, std::size_t lanes, double vector_error) {
  SCOPED_TRACE(testing::Message() << p.signals << " signals of " << p.n << ", " << p.atoms
                                  << " atoms, k " << p.k << ", " << lanes << " lanes, "
                                  << name_of(update));
  std::vector<double> D = in_double(p.D);
  std::vector<double> x = in_double(p.coefficients);
  reference::update_atoms(p.n, p.k, update, in_double(p.Y), p.indices, x, D);
  const Updated found = update_on_device(p, update, lanes);
  // Every sum of an atom is one over its signals, or along a row; an atom's error passes on to
  // those after it through the residual.
  const double terms = static_cast<double>(p.signals + p.leading() + 8);
  const double unit =
      static_cast<double>(p.atoms) * (gamma(4 * terms, float_roundoff) + vector_error);
  double largest = 0;
  for (const double value : x) largest = std::max(largest, std::abs(value));
  EXPECT_TRUE(all_near(found.D, D, unit));
  EXPECT_TRUE(all_near(found.coefficients, x, unit * (1 + 3 * largest)));
  // R is that of what came out
  const Problem::Residual expected = p.residual(in_double(found.D), in_double(found.coefficients));
  EXPECT_TRUE(all_near(found.R, expected.r, [&](std::size_t i) {
    return 4 * gamma(static_cast<double>(3 * p.k + 2), float_roundoff) *
           (expected.magnitude[i] + largest);
  }));
  const double before = norm(p.residual(in_double(p.D), in_double(p.coefficients)).r);
  EXPECT_LE(norm(expected.r), before * (1 + gamma(terms, float_roundoff)));
  EXPECT_EQ(found.steps > 0, update == KsvdUpdate::exact);
}

TEST(KsvdUpdate, ApproximateUpdateOfFewSignals) {
  for (const std::size_t lanes : {std::size_t{1}, std::size_t{8}}) {
    expect_updated(Problem(1, 1, 2, 1), KsvdUpdate::approximate, lanes, 0);
    expect_updated(Problem(9, 17, 4, 2), KsvdUpdate::approximate, lanes, 0);
  }
}

TEST(KsvdUpdate, ApproximateUpdate) {
  // with one atom, all signals are its; with 256 granules of 32 at most, they grow from 8192 on
  for (const std::size_t signals : Sizes{31, 32, 33, 35, 100}) {
    expect_updated(Problem(signals, 19, 1, 1), KsvdUpdate::approximate, 1, 0);
  }
  for (const std::size_t n : Sizes{1, 15, 16, 17, 64, 130}) {
    expect_updated(Problem(200, n, 12, 4), KsvdUpdate::approximate, 1, 0);
    expect_updated(Problem(200, n, 12, 4), KsvdUpdate::approximate, 8, 0);
  }
  expect_updated(Problem(8200, 3, 1, 1), KsvdUpdate::approximate, 1, 0);
}

TEST(KsvdUpdate, SmallExactUpdate) {
  // With little noise E is nearly of rank 1: few steps of the power iteration end it.
  for (const std::size_t lanes : {std::size_t{1}, std::size_t{8}}) {
    expect_updated(Problem(9, 17, 4, 2, 1e-3), KsvdUpdate::exact, lanes, 1e-3);
  }
}

TEST(KsvdUpdate, ExactUpdate) {
  for (const std::size_t n : Sizes{2, 16, 40}) {
    expect_updated(Problem(400, n, 5, 2, 1e-3), KsvdUpdate::exact, 1, 1e-3);
    expect_updated(Problem(400, n, 5, 2, 1e-3), KsvdUpdate::exact, 8, 1e-3);
  }
}

// One atom of all signals: the exact update is the best rank-1 approximation, also where the
// leading singular values lie near each other.
TEST(KsvdUpdate, ExactUpdateReachesTheLeadingSingularValue) {
  Problem p(90, 30, 1, 1);
  std::vector<double> values(30);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::pow(0.95, i);
  const std::vector<double> matrix = matrix_with_singular_values(90, 30, values, 5);
  p.Y.assign(matrix.begin(), matrix.end());
  std::fill(p.coefficients.begin(), p.coefficients.end(), 1.0f);
  const Updated found = update_on_device(p, KsvdUpdate::exact, 1);
  const double left = std::pow(norm(in_double(found.R)), 2);
  double expected = -1;
  for (const double value : values) expected += value * value;
  // the Rayleigh quotient is within the square of the residual, 2^-10, over the gap of the squares
  EXPECT_NEAR(left, expected, 0x1p-20 / (1 - 0.95 * 0.95) + 90 * 0x1p-24);
  EXPECT_GT(found.steps, 8U);
}

TEST(KsvdUpdate, AtomsWithoutUseStay) {
  const Problem p(50, 20, 6, 3, 0.3, 4);
  for (const KsvdUpdate update : {KsvdUpdate::approximate, KsvdUpdate::exact}) {
    const Updated found = update_on_device(p, update, 1);
    for (std::size_t i = 0; i < p.n; ++i) EXPECT_EQ(found.D[4 * p.n + i], p.D[4 * p.n + i]);
    for (std::size_t e = 0; e < p.indices.size(); ++e) {
      if (p.indices[e] != 4) continue;
      EXPECT_EQ(found.coefficients[e], 0.0f);
    }
  }
}

// Signals that cancel leave no direction: the atom stays, and its coefficients are the products.
TEST(KsvdUpdate, AtomOfNoDirectionStays) {
  Problem p(2, 5, 1, 1);
  for (std::size_t i = 0; i < p.n; ++i) p.Y[p.n + i] = -p.Y[i];
  p.coefficients = {1.0f, 1.0f};
  const Updated found = update_on_device(p, KsvdUpdate::approximate, 1);
  EXPECT_TRUE(all_near(found.D, p.D, 8 * float_roundoff));
  EXPECT_TRUE(all_near(std::vector<float>{found.coefficients[0]},
                       std::vector<float>{-found.coefficients[1]}, 16 * float_roundoff));
}

TEST(KsvdUpdate, UsesAreSortedByAtomThenSignal) {
  const ops::CodeShape shape{3, 16, 4, 2};
  const ops::AtomUses uses = ops::atom_uses(shape, std::vector<std::uint32_t>{2, 0, 0, 3, 2, 0},
                                            std::vector<float>{1, 2, 3, 0, -1, 5});
  EXPECT_TRUE(all_equal(uses.first, std::vector<std::size_t>{0, 3, 3, 5, 5}));
  EXPECT_TRUE(all_equal(uses.entries, std::vector<std::uint32_t>{1, 2, 5, 0, 4}));
  EXPECT_TRUE(
      all_equal(ops::atom_uses({0, 16, 2, 2}, {}, {}).first, std::vector<std::size_t>(3, 0)));
  const ops::CodeShape large{std::size_t{1} << 31, 16, 4, 2};
  expect_error(ErrorKind::input, {"2147483648"}, [&] { ops::atom_uses(large, {}, {}); });
}

TEST(KsvdUpdate, SameBitsTwice) {
  const Problem p(300, 33, 20, 4);
  for (const KsvdUpdate update : {KsvdUpdate::approximate, KsvdUpdate::exact}) {
    const Updated first = update_on_device(p, update, 1);
    const Updated second = update_on_device(p, update, 1);
    EXPECT_TRUE(all_equal(first.D, second.D));
    EXPECT_TRUE(all_equal(first.R, second.R));
  }
}

}  // namespace
}  // namespace weft::test
