// K-SVD on the device: against the reference, and by what is known of it: planted dictionaries are
// found, the objective is what it says and ends at its least, and nothing but the signals, the
// options and the device decides about the result.
#include "weft/codecs/ksvd.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/shared_device.hpp"

namespace weft::test {
namespace {

double squares(std::span<const float> values) {
  double sum = 0;
  for (const float value : values) sum += double{value} * double{value};
  return sum;
}

std::vector<float> unit_rows(std::size_t rows, std::size_t n, std::uint64_t seed) {
  std::vector<float> D = random_floats(rows * n, seed, -1, 1);
  for (std::size_t j = 0; j < rows; ++j) {
    const double length = std::sqrt(squares(std::span<const float>(D).subspan(j * n, n)));
    for (std::size_t i = 0; i < n; ++i) {
      D[j * n + i] = static_cast<float>(double{D[j * n + i]} / length);
    }
  }
  return D;
}

// Signals with k entries in a dictionary, plus noise.
std::vector<float> sparse_signals(std::span<const float> D, std::size_t n, std::size_t signals,
                                  std::size_t k, double noise, std::uint64_t seed) {
  const std::size_t atoms = D.size() / n;
  Random random(seed);
  std::vector<float> Y(signals * n);
  for (float& value : Y) value = static_cast<float>(noise * random.normal());
  for (std::size_t i = 0; i < signals; ++i) {
    std::set<std::size_t> support;
    while (support.size() < k) support.insert(random.index(atoms));
    for (const std::size_t j : support) {
      const double x = random.uniform(0.5, 2) * (random.uniform() < 0.5 ? -1 : 1);
      for (std::size_t l = 0; l < n; ++l) {
        Y[i * n + l] += static_cast<float>(x * double{D[j * n + l]});
      }
    }
  }
  return Y;
}

KsvdFit<float> fit_on_device(std::size_t n, std::span<const float> Y, const KsvdOptions& options,
                             std::span<const float> given = {}) {
  Job job;
  return ksvd(shared_device(), KsvdSignals::of(n, Y), options, given, job);
}

KsvdOptions options_of(std::size_t atoms, std::size_t k, std::size_t iterations,
                       KsvdUpdate update = KsvdUpdate::approximate) {
  KsvdOptions options;
  options.atoms = atoms;
  options.sparsity = k;
  options.iterations = iterations;
  options.update = update;
  return options;
}

// Unit atoms, legal codes, an objective that is that of the codes and the least that was seen.
void expect_sound(const KsvdFit<float>& fit, std::size_t n, std::span<const float> Y,
                  const KsvdOptions& options) {
  const std::size_t signals = Y.size() / n;
  const std::size_t k = options.sparsity;
  ASSERT_EQ(fit.dictionary.size(), options.atoms * n);
  ASSERT_EQ(fit.indices.size(), signals * k);
  ASSERT_EQ(fit.coefficients.size(), signals * k);
  ASSERT_EQ(fit.counts.size(), signals);
  for (std::size_t j = 0; j < options.atoms; ++j) {
    EXPECT_NEAR(squares(std::span<const float>(fit.dictionary).subspan(j * n, n)), 1,
                gamma(static_cast<double>(n + 8), float_roundoff));
  }
  double objective = 0;
  for (std::size_t i = 0; i < signals; ++i) {
    std::vector<double> r(Y.begin() + static_cast<std::ptrdiff_t>(i * n),
                          Y.begin() + static_cast<std::ptrdiff_t>((i + 1) * n));
    std::set<std::uint32_t> support;
    ASSERT_LE(fit.counts[i], k);
    for (std::size_t s = 0; s < k; ++s) {
      const std::uint32_t atom = fit.indices[i * k + s];
      const double x = fit.coefficients[i * k + s];
      ASSERT_LT(atom, options.atoms);
      ASSERT_TRUE(std::isfinite(x));
      if (s >= fit.counts[i]) {
        ASSERT_EQ(x, 0);
      } else {
        ASSERT_TRUE(support.insert(atom).second) << "twice in signal " << i;
      }
      for (std::size_t l = 0; l < n; ++l) r[l] -= x * double{fit.dictionary[atom * n + l]};
    }
    objective += std::inner_product(r.begin(), r.end(), r.begin(), 0.0);
  }
  // A row's terms are rounded once per entry of its code; the cross term of that with what is left.
  const double total = squares(Y);
  const double rounding = gamma(4 * static_cast<double>(k + n) + 16, float_roundoff);
  EXPECT_NEAR(
      fit.objective, objective,
      rounding * (objective + 2 * std::sqrt(objective * total)) + rounding * rounding * total);
  EXPECT_EQ(fit.objective, *std::min_element(fit.objectives.begin(), fit.objectives.end()));
  EXPECT_EQ(fit.objective, fit.objectives.at(fit.best));
  EXPECT_EQ(fit.replaced.size() + 1, fit.objectives.size());
  EXPECT_LE(fit.replaced.size(), options.iterations);
}

std::size_t atoms_found(std::span<const float> planted, std::span<const float> D, std::size_t n) {
  std::size_t found = 0;
  for (std::size_t j = 0; j < planted.size() / n; ++j) {
    double best = 0;
    for (std::size_t l = 0; l < D.size() / n; ++l) {
      double dot = 0;
      for (std::size_t i = 0; i < n; ++i) dot += double{planted[j * n + i]} * double{D[l * n + i]};
      best = std::max(best, std::abs(dot));
    }
    if (best > 0.99) ++found;
  }
  return found;
}

TEST(Ksvd, FindsAPlantedDictionary) {
  const std::size_t n = 20, atoms = 24;
  const std::vector<float> planted = unit_rows(atoms, n, 3);
  const std::vector<float> Y = sparse_signals(planted, n, 1500, 2, 0.01, 4);
  for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
    SCOPED_TRACE(name_of(update));
    const KsvdOptions options = options_of(atoms, 2, 60, update);
    const KsvdFit<float> fit = fit_on_device(n, Y, options);
    expect_sound(fit, n, Y, options);
    // Aharon, Elad & Bruckstein (section V-A) find 92 % and more.
    EXPECT_GE(atoms_found(planted, fit.dictionary, n), atoms * 9 / 10);
    EXPECT_LT(fit.objective, 0.25 * fit.objectives[0]);
  }
}

TEST(Ksvd, RecoversADictionaryFromNearIt) {
  const std::size_t n = 32, atoms = 24;
  const std::vector<float> planted = unit_rows(atoms, n, 7);
  const std::vector<float> Y = sparse_signals(planted, n, 800, 2, 0, 8);
  std::vector<float> near = planted;
  Random random(2);
  for (float& value : near) value += static_cast<float>(0.05 * random.normal());
  for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
    KsvdOptions options = options_of(atoms, 2, 40, update);
    options.start = KsvdStart::given;
    const KsvdFit<float> fit = fit_on_device(n, Y, options, near);
    expect_sound(fit, n, Y, options);
    EXPECT_EQ(atoms_found(planted, fit.dictionary, n), atoms);
    EXPECT_LT(fit.objective, 1e-6 * squares(Y));
  }
}

TEST(Ksvd, CodesWhatTheDictionaryHoldsExactly) {
  const std::size_t n = 40, atoms = 30;
  const std::vector<float> planted = unit_rows(atoms, n, 9);
  const std::vector<float> Y = sparse_signals(planted, n, 300, 2, 0, 10);
  KsvdOptions options = options_of(atoms, 2, 10);
  options.start = KsvdStart::given;
  const KsvdFit<float> fit = fit_on_device(n, Y, options, planted);
  expect_sound(fit, n, Y, options);
  EXPECT_LT(fit.objectives[0], 1e-9 * squares(Y));
}

// The same start and the same updates: what differs are near ties of the pursuit, which matter
// little at once and more with every iteration.
TEST(Ksvd, FollowsTheReference) {
  const std::size_t n = 24, atoms = 20, signals = 400;
  const std::vector<float> Y = sparse_signals(unit_rows(atoms, n, 11), n, signals, 3, 0.2, 12);
  const std::vector<double> exact(Y.begin(), Y.end());
  for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
    for (const KsvdStart start : {KsvdStart::samples, KsvdStart::random}) {
      for (const std::size_t batch : {std::size_t{0}, std::size_t{150}}) {
        KsvdOptions options = options_of(atoms, 3, 4, update);
        options.start = start;
        options.batch = batch;
        SCOPED_TRACE(testing::Message() << name_of(update) << ", batch " << batch);
        const KsvdFit<float> found = fit_on_device(n, Y, options);
        const KsvdFit<double> expected = reference::ksvd(n, exact, options);
        expect_sound(found, n, Y, options);
        ASSERT_EQ(found.objectives.size(), expected.objectives.size());
        EXPECT_NEAR(found.objectives[0], expected.objectives[0], 1e-5 * expected.objectives[0]);
        EXPECT_NEAR(found.objectives[1], expected.objectives[1], 1e-2 * expected.objectives[1]);
        EXPECT_NEAR(found.objective, expected.objective, 0.05 * expected.objective);
        EXPECT_EQ(found.replaced[0], expected.replaced[0]);
      }
    }
  }
}

TEST(Ksvd, NeverRisesWhereNothingIsReplaced) {
  const std::size_t n = 30, atoms = 40;
  const std::vector<float> Y = sparse_signals(unit_rows(60, n, 13), n, 900, 4, 0.3, 14);
  for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
    const KsvdOptions options = options_of(atoms, 3, 12, update);
    const KsvdFit<float> fit = fit_on_device(n, Y, options);
    expect_sound(fit, n, Y, options);
    for (std::size_t t = 1; t < fit.objectives.size(); ++t) {
      if (fit.replaced[t - 1] > 0) continue;
      EXPECT_LE(fit.objectives[t], fit.objectives[t - 1] * (1 + 1e-5)) << "iteration " << t;
    }
  }
}

TEST(Ksvd, StartsWarm) {
  const std::size_t n = 30, atoms = 32;
  const std::vector<float> Y = sparse_signals(unit_rows(50, n, 15), n, 700, 4, 0.2, 16);
  KsvdOptions options = options_of(atoms, 4, 8);
  const KsvdFit<float> cold = fit_on_device(n, Y, options);
  options.start = KsvdStart::given;
  options.iterations = 0;
  const KsvdFit<float> coded = fit_on_device(n, Y, options, cold.dictionary);
  expect_sound(coded, n, Y, options);
  EXPECT_TRUE(all_near(coded.dictionary, cold.dictionary, 4 * float_roundoff));
  // far below where the samples began, and better from there
  EXPECT_LT(coded.objective, 0.8 * cold.objectives[0]);
  options.iterations = 8;
  const KsvdFit<float> warm = fit_on_device(n, Y, options, cold.dictionary);
  EXPECT_EQ(warm.objectives[0], coded.objective);
  EXPECT_LE(warm.objective, coded.objective);
}

TEST(Ksvd, ReplacesAtomsThatAreNotNeeded) {
  const std::size_t n = 16, atoms = 20;
  const std::vector<float> planted = unit_rows(atoms, n, 17);
  const std::vector<float> Y = sparse_signals(planted, n, 600, 2, 0.01, 18);
  // half of the atoms are the same one, up to sign and length
  std::vector<float> given = planted;
  for (std::size_t j = atoms / 2; j < atoms; ++j) {
    for (std::size_t i = 0; i < n; ++i) {
      given[j * n + i] = planted[i] * (j % 2 == 0 ? 3.0f : -0.5f);
    }
  }
  KsvdOptions options = options_of(atoms, 2, 25);
  options.start = KsvdStart::given;
  const KsvdFit<float> fit = fit_on_device(n, Y, options, given);
  expect_sound(fit, n, Y, options);
  // two of them may have been updated by different signals before they are compared
  EXPECT_GE(fit.replaced[0], atoms / 2 - 2);
  EXPECT_GE(atoms_found(planted, fit.dictionary, n), atoms * 3 / 4);
  EXPECT_LT(fit.objective, 0.2 * fit.objectives[0]);
}

TEST(Ksvd, StopsWhereLittleIsGained) {
  const std::size_t n = 20, atoms = 24;
  const std::vector<float> Y = sparse_signals(unit_rows(atoms, n, 19), n, 500, 3, 0.3, 20);
  KsvdOptions options = options_of(atoms, 3, 40);
  options.tolerance = 0.02;
  const KsvdFit<float> fit = fit_on_device(n, Y, options);
  const std::size_t last = fit.replaced.size();
  ASSERT_LT(last, 40U);
  EXPECT_LE(fit.objectives[last - 1] - fit.objectives[last], 0.02 * fit.objectives[last - 1]);
  for (std::size_t t = 1; t < last; ++t) {
    EXPECT_TRUE(fit.replaced[t - 1] > 0 ||
                fit.objectives[t - 1] - fit.objectives[t] > 0.02 * fit.objectives[t - 1]);
  }
}

TEST(Ksvd, BatchesComeNearTheWhole) {
  const std::size_t n = 20, atoms = 24;
  const std::vector<float> Y = sparse_signals(unit_rows(atoms, n, 21), n, 2000, 3, 0.1, 22);
  KsvdOptions options = options_of(atoms, 3, 20);
  const KsvdFit<float> whole = fit_on_device(n, Y, options);
  options.batch = 600;  // the last has 200
  const KsvdFit<float> batches = fit_on_device(n, Y, options);
  expect_sound(batches, n, Y, options);
  EXPECT_LT(batches.objective, 0.5 * batches.objectives[0]);
  EXPECT_LT(batches.objective, 1.5 * whole.objective);
  options.batch = 2000;
  EXPECT_TRUE(all_equal(fit_on_device(n, Y, options).dictionary, whole.dictionary));
}

TEST(Ksvd, SameBitsForTheSameSeed) {
  const std::size_t n = 33, atoms = 20;
  const std::vector<float> Y = sparse_signals(unit_rows(30, n, 23), n, 500, 3, 0.3, 24);
  KsvdOptions options = options_of(atoms, 3, 5, KsvdUpdate::exact);
  const KsvdFit<float> first = fit_on_device(n, Y, options);
  Job lavish;
  lavish.memory *= 4;
  // a source that is read in parts
  KsvdSignals signals = KsvdSignals::of(n, Y);
  const KsvdFit<float> second = ksvd(shared_device(), signals, options, {}, lavish);
  EXPECT_TRUE(all_equal(second.dictionary, first.dictionary));
  EXPECT_TRUE(all_equal(second.coefficients, first.coefficients));
  EXPECT_TRUE(all_equal(second.indices, first.indices));
  EXPECT_TRUE(all_equal(second.objectives, first.objectives));
  options.seed = 1;
  EXPECT_FALSE(all_equal(fit_on_device(n, Y, options).dictionary, first.dictionary));
}

// Powers of two change exponents only; a signal may be of any magnitude.
TEST(Ksvd, MagnitudesDoNotMatter) {
  const std::size_t n = 17, atoms = 12;
  const std::vector<float> Y = sparse_signals(unit_rows(20, n, 25), n, 200, 3, 0.3, 26);
  const KsvdOptions options = options_of(atoms, 3, 4);
  const KsvdFit<float> fit = fit_on_device(n, Y, options);
  for (const float factor : {0x1p-98f, 0x1p98f}) {
    std::vector<float> scaled = Y;
    for (float& value : scaled) value *= factor;
    const KsvdFit<float> found = fit_on_device(n, scaled, options);
    expect_sound(found, n, scaled, options);
    EXPECT_TRUE(all_equal(found.dictionary, fit.dictionary));
    EXPECT_TRUE(all_equal(found.indices, fit.indices));
    EXPECT_EQ(found.objective, fit.objective * double{factor} * double{factor});
  }
  // magnitudes that differ within one matrix
  std::vector<float> mixed = Y;
  for (std::size_t i = 0; i < mixed.size(); ++i) {
    mixed[i] *= std::ldexp(1.0f, static_cast<int>(i / n % 7) * 30 - 90);
  }
  for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
    KsvdOptions some = options;
    some.update = update;
    expect_sound(fit_on_device(n, mixed, some), n, mixed, some);
  }
}

TEST(Ksvd, DegenerateSignals) {
  const auto expect_fit = [](const char* what, std::size_t n, const std::vector<float>& Y,
                             const KsvdOptions& options, double most) {
    SCOPED_TRACE(what);
    for (const KsvdUpdate update : {KsvdUpdate::exact, KsvdUpdate::approximate}) {
      KsvdOptions some = options;
      some.update = update;
      const KsvdFit<float> fit = fit_on_device(n, Y, some);
      expect_sound(fit, n, Y, some);
      EXPECT_LE(fit.objective, most * squares(Y));
    }
  };
  const std::vector<float> some = random_floats(60, 31, -1, 1);
  expect_fit("zeros", 5, std::vector<float>(100, 0.0f), options_of(4, 2, 3), 0);
  std::vector<float> with_zeros(200, 0.0f);
  std::copy(some.begin(), some.end(), with_zeros.begin() + 70);
  expect_fit("some zeros", 5, with_zeros, options_of(4, 2, 5), 0.9);
  std::vector<float> identical;
  for (std::size_t i = 0; i < 50; ++i) {
    identical.insert(identical.end(), some.begin(), some.begin() + 6);
  }
  expect_fit("identical", 6, identical, options_of(4, 2, 5), 1e-10);
  expect_fit("more atoms than signals", 6, some, options_of(20, 1, 3), 1e-10);
  expect_fit("one signal", 60, some, options_of(3, 2, 3), 1e-10);
  expect_fit("dimension 1", 1, some, options_of(3, 2, 3), 1e-10);
  expect_fit("one atom", 3, some, options_of(1, 1, 5), 0.9);
  expect_fit("more entries than atoms", 3, some, options_of(2, 5, 3), 0.9);
  expect_fit("more entries than dimensions", 3, some, options_of(8, 6, 3), 1e-10);
  // rank 2 in 12 dimensions
  std::vector<float> flat;
  for (std::size_t i = 0; i < 100; ++i) {
    for (std::size_t j = 0; j < 12; ++j) {
      flat.push_back(some[i % 50] * some[j] + some[(i * 7) % 53] * some[j + 20]);
    }
  }
  expect_fit("rank 2", 12, flat, options_of(10, 2, 5), 1e-9);
}

TEST(Ksvd, RefusesWhatCanNotBe) {
  const std::vector<float> Y = random_floats(100, 33, -1, 1);
  const KsvdOptions options = options_of(4, 2, 3);
  expect_error(ErrorKind::input, {"0 signals", "dimension 10"},
               [&] { fit_on_device(10, {}, options); });
  expect_error(ErrorKind::input, {"0 atoms"}, [&] { fit_on_device(10, Y, options_of(0, 2, 3)); });
  expect_error(ErrorKind::input, {"4 atoms, 0"},
               [&] { fit_on_device(10, Y, options_of(4, 0, 3)); });
  KsvdOptions given = options;
  given.start = KsvdStart::given;
  expect_error(ErrorKind::input, {"39 values", "4 x 10"},
               [&] { fit_on_device(10, Y, given, std::span(Y).first(39)); });
  expect_error(ErrorKind::input, {"39 values", "4 x 10"}, [&] {
    reference::ksvd(10, std::vector<double>(100, 1.0), given, std::vector<double>(39, 1.0));
  });
  std::vector<float> infinite(40, 1.0f);
  infinite[23] = std::numeric_limits<float>::infinity();
  expect_error(ErrorKind::input, {"dictionary", "inf", "atom 2", "dimension 3"},
               [&] { fit_on_device(10, Y, given, infinite); });
  expect_error(ErrorKind::input, {"100 values", "rows of 0"},
               [&] { reference::ksvd(0, std::vector<double>(100, 1.0), options); });
  expect_error(ErrorKind::input, {"100 values", "rows of 7"},
               [&] { reference::ksvd(7, std::vector<double>(100, 1.0), options); });
  KsvdOptions tolerance = options;
  tolerance.tolerance = std::numeric_limits<double>::quiet_NaN();
  expect_error(ErrorKind::input, {"tolerance"}, [&] { fit_on_device(10, Y, tolerance); });
  std::vector<float> broken = Y;
  broken[37] = std::numeric_limits<float>::quiet_NaN();
  expect_error(ErrorKind::input, {"signal 3", "dimension 7"},
               [&] { fit_on_device(10, broken, options); });
  Job small;
  small.memory = 1000;
  expect_error(ErrorKind::input, {"memory"},
               [&] { ksvd(shared_device(), KsvdSignals::of(10, Y), options, {}, small); });
}

// What does not fit at once fits in batches, and no more is taken than was planned.
TEST(Ksvd, KeepsToItsMemory) {
  const std::size_t n = 64, signals = 20000;
  const std::vector<float> Y = sparse_signals(unit_rows(20, n, 37), n, signals, 2, 0.1, 38);
  Device& device = shared_device();
  KsvdOptions options = options_of(16, 2, 1);
  Job job;
  std::size_t planned = 0;
  job.on_plan = [&](const MemoryPlan& plan) { planned = plan.total(); };
  const std::size_t before = device.allocated();
  ksvd(device, KsvdSignals::of(n, Y), options, {}, job);
  EXPECT_LE(device.peak_allocated() - before, planned);
  const std::size_t whole = planned;
  options.batch = 2000;
  job.memory = ksvd_plan(device, signals, n, options).total();
  EXPECT_LT(job.memory, whole);
  const KsvdFit<float> fit = ksvd(device, KsvdSignals::of(n, Y), options, {}, job);
  expect_sound(fit, n, Y, options);
  options.batch = 0;
  expect_error(ErrorKind::input, {"memory"},
               [&] { ksvd(device, KsvdSignals::of(n, Y), options, {}, job); });
}

// Of all signals only the codes are held, on the host: what the device allocates at once bounds a
// batch and not their number.
TEST(Ksvd, PlansMoreSignalsThanTheDeviceHolds) {
  Device& device = shared_device();
  KsvdOptions options = options_of(16, 8, 1);
  const std::size_t largest = device.limits().largest_allocation;
  const std::size_t signals = largest / (options.sparsity * sizeof(float)) + 1;
  options.batch = 1000;
  EXPECT_GT(ksvd_plan(device, signals, 4, options).total(), largest);
  options.batch = 0;
  expect_error(ErrorKind::input, {std::to_string(signals), "in one piece"},
               [&] { ksvd_plan(device, signals, 4, options); });
  options.batch = 1000;
  expect_error(ErrorKind::input, {"72057594037927936 signals of 8 atoms"},
               [&] { ksvd_plan(device, std::size_t{1} << 56, 4, options); });
}

TEST(Ksvd, TellsWhatItDid) {
  const std::vector<float> Y = random_floats(400, 35, -1, 1);
  Job job;
  std::vector<std::size_t> done;
  job.progress = [&](const std::string& stage, std::size_t at, std::size_t total) {
    EXPECT_EQ(stage, "texels");
    EXPECT_EQ(total, 3U);
    done.push_back(at);
  };
  std::size_t planned = 0;
  job.on_plan = [&](const MemoryPlan& plan) { planned = plan.total(); };
  Device& device = shared_device();
  const std::size_t before = device.allocated();
  const KsvdFit<float> fit =
      ksvd(device, KsvdSignals::of(10, Y), options_of(6, 2, 3), {}, job, "texels");
  EXPECT_EQ(device.allocated(), before);
  EXPECT_GT(planned, 0U);
  EXPECT_EQ(done, (std::vector<std::size_t>{1, 2, 3}));
  EXPECT_GT(job.stage("texels: coding").flops, 0);
  EXPECT_GT(job.stage("texels: atoms").bytes, 0);
  ASSERT_EQ(job.notes.size(), 1U);
  EXPECT_NE(job.notes[0].find("texels: |Y - X D| / |Y|"), std::string::npos);
}

}  // namespace
}  // namespace weft::test
