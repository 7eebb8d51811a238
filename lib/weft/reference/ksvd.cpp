#include "weft/reference/ksvd.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"
#include "weft/reference/batch_omp.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/ksvd_atoms.hpp"

namespace weft {

std::string_view name_of(KsvdUpdate update) {
  return update == KsvdUpdate::exact ? "exact" : "approximate";
}

}  // namespace weft

namespace weft::reference {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

// Where a code has an atom: entry i k + s of signal i.
struct Use {
  std::size_t signal = 0;
  std::size_t entry = 0;
};

// The uses of every atom, by signal.
std::vector<std::vector<Use>> uses_of(std::size_t atoms, std::size_t k,
                                      std::span<const std::uint32_t> indices,
                                      std::span<const double> coefficients) {
  std::vector<std::vector<Use>> uses(atoms);
  for (std::size_t entry = 0; entry < indices.size(); ++entry) {
    if (coefficients[entry] != 0) uses[indices[entry]].push_back({entry / k, entry});
  }
  return uses;
}

// y_i - x_i D
Eigen::RowVectorXd residual(std::span<const double> signals, std::span<const double> dictionary,
                            std::size_t n, std::size_t signal,
                            std::span<const std::uint32_t> indices,
                            std::span<const double> coefficients) {
  Eigen::RowVectorXd r =
      Eigen::Map<const Eigen::RowVectorXd>(signals.data() + signal * n, index(n));
  for (std::size_t s = 0; s < indices.size(); ++s) {
    r -= coefficients[s] *
         Eigen::Map<const Eigen::RowVectorXd>(dictionary.data() + indices[s] * n, index(n));
  }
  return r;
}

// Codes all signals; those with a code keep its support where the new one is worse.
class Coder {
 public:
  Coder(std::size_t dimension, std::span<const double> signals, const KsvdOptions& options)
      : n_(dimension),
        signals_(signals),
        atoms_(options.atoms),
        k_(options.sparsity),
        errors_(signals.size() / dimension) {}

  // Returns |Y - X D|^2.
  double code(std::span<const double> dictionary, KsvdFit<double>& fit) {
    const bool first = fit.indices.empty();
    OmpTarget target;
    target.sparsity = k_;
    const SparseCodes codes = batch_omp(atoms_, n_, dictionary, signals_, target);
    if (first) {
      fit.indices = codes.indices;
      fit.coefficients = codes.coefficients;
      fit.counts = codes.counts;
    }
    double total = 0;
    for (std::size_t i = 0; i < errors_.size(); ++i) {
      const auto error_of = [&](const auto& some) {
        return residual(signals_, dictionary, n_, i, std::span(some.indices).subspan(i * k_, k_),
                        std::span(some.coefficients).subspan(i * k_, k_))
            .squaredNorm();
      };
      errors_[i] = error_of(codes);
      const double kept = first ? errors_[i] : error_of(fit);
      if (kept < errors_[i]) {
        errors_[i] = kept;
      } else {
        const auto at = static_cast<std::ptrdiff_t>(i * k_);
        std::copy_n(codes.indices.begin() + at, k_, fit.indices.begin() + at);
        std::copy_n(codes.coefficients.begin() + at, k_, fit.coefficients.begin() + at);
        fit.counts[i] = codes.counts[i];
      }
      total += errors_[i];
    }
    return total;
  }
  const std::vector<double>& errors() const { return errors_; }

 private:
  std::size_t n_;
  std::span<const double> signals_;
  std::size_t atoms_;
  std::size_t k_;
  std::vector<double> errors_;
};

// Atoms without use, and those that are the same as an earlier one.
std::vector<bool> needless_atoms(std::size_t n, const KsvdFit<double>& fit) {
  const std::size_t atoms = fit.dictionary.size() / n;
  const Eigen::Map<const RowMajor> D(fit.dictionary.data(), index(atoms), index(n));
  std::vector<bool> needless(atoms, true);
  for (std::size_t entry = 0; entry < fit.indices.size(); ++entry) {
    if (fit.coefficients[entry] != 0) needless[fit.indices[entry]] = false;
  }
  for (std::size_t j = 0; j < atoms; ++j) {
    for (std::size_t l = 0; l < j && !needless[j]; ++l) {
      needless[j] =
          !needless[l] && std::abs(D.row(index(j)).dot(D.row(index(l)))) > duplicate_atoms;
    }
  }
  return needless;
}

// The power of two that brings the largest magnitude near 1.
double scale_of(std::span<const double> values) {
  double largest = 0;
  for (const double value : values) largest = std::max(largest, std::abs(value));
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0, std::clamp(-exponent, -500, 500));
}

}  // namespace

void update_atoms(std::size_t dimension, std::size_t k, KsvdUpdate update,
                  std::span<const double> signals, std::span<const std::uint32_t> indices,
                  std::span<double> coefficients, std::span<double> dictionary) {
  const std::size_t n = dimension;
  const std::size_t atoms = dictionary.size() / n;
  const std::vector<std::vector<Use>> uses = uses_of(atoms, k, indices, coefficients);
  for (std::size_t j = 0; j < atoms; ++j) {
    if (uses[j].empty()) continue;
    // E_j and the coefficients of the atom
    const std::size_t size = uses[j].size();
    RowMajor E(index(size), index(n));
    Eigen::VectorXd x(index(size));
    Eigen::Map<Eigen::RowVectorXd> d(dictionary.data() + j * n, index(n));
    for (std::size_t u = 0; u < size; ++u) {
      const Use& use = uses[j][u];
      x(index(u)) = coefficients[use.entry];
      E.row(index(u)) =
          residual(signals, dictionary, n, use.signal, indices.subspan(use.signal * k, k),
                   coefficients.subspan(use.signal * k, k)) +
          x(index(u)) * d;
    }
    if (update == KsvdUpdate::exact) {
      const ThinSvd svd =
          thin_svd(size, n, std::span(E.data(), static_cast<std::size_t>(E.size())));
      if (svd.values[0] == 0) continue;
      const std::size_t r = svd.values.size();
      Eigen::RowVectorXd leading(index(n));
      for (std::size_t i = 0; i < n; ++i) leading(index(i)) = svd.V[i * r];
      d = leading.dot(d) < 0 ? Eigen::RowVectorXd(-leading) : leading;
    } else {
      const Eigen::RowVectorXd step = x.transpose() * E;
      if (step.norm() == 0) continue;
      d = step / step.norm();
    }
    x = E * d.transpose();
    for (std::size_t u = 0; u < size; ++u) coefficients[uses[j][u].entry] = x(index(u));
  }
}

KsvdFit<double> ksvd(std::size_t dimension, std::span<const double> signals,
                     const KsvdOptions& options, std::span<const double> given) {
  const std::size_t n = dimension;
  if (n == 0 || signals.size() % n != 0) {
    fail_input("K-SVD of {} values in rows of {}", signals.size(), n);
  }
  check_ksvd(signals.size() / n, n, options, given.size());
  const double scale = scale_of(signals);
  std::vector<double> Y(signals.begin(), signals.end());
  for (double& value : Y) value *= scale;
  const SignalReader reader{Y.size() / n, n, [&](std::size_t i, std::span<double> values) {
                              std::copy_n(Y.data() + i * n, n, values.data());
                            }};
  const std::size_t k = options.sparsity;
  const std::size_t batch = options.batch == 0 ? reader.signals : options.batch;
  const bool whole = batch >= reader.signals;

  KsvdFit<double> state;
  state.dictionary = initial_atoms(reader, options, given);
  Coder coder(n, Y, options);
  state.objective = coder.code(state.dictionary, state);
  state.objectives.push_back(state.objective);
  KsvdFit<double> best = state;
  for (std::size_t t = 1; t <= options.iterations; ++t) {
    if (whole) {
      update_atoms(n, k, options.update, Y, state.indices, state.coefficients, state.dictionary);
    } else {
      for (std::size_t first = 0; first < reader.signals; first += batch) {
        const std::size_t count = std::min(batch, reader.signals - first);
        const std::span<const double> part =
            std::span<const double>(Y).subspan(first * n, count * n);
        OmpTarget target;
        target.sparsity = k;
        SparseCodes codes = batch_omp(options.atoms, n, state.dictionary, part, target);
        update_atoms(n, k, options.update, part, codes.indices, codes.coefficients,
                     state.dictionary);
      }
    }
    const std::size_t replaced =
        replace_atoms(reader, coder.errors(), needless_atoms(n, state), state.dictionary);
    if (!whole) state.indices.clear();  // coded anew
    const double objective = coder.code(state.dictionary, state);
    const double before = state.objective;
    state.objective = objective;
    state.objectives.push_back(objective);
    state.replaced.push_back(replaced);
    if (objective < best.objective) {
      best = state;
      best.best = t;
    }
    if (replaced == 0 && before - objective <= options.tolerance * before) break;
  }
  best.objectives = state.objectives;
  best.replaced = state.replaced;
  // back to the unit of the signals
  for (double& value : best.coefficients) value /= scale;
  best.objective /= scale * scale;
  for (double& value : best.objectives) value /= scale * scale;
  return best;
}

}  // namespace weft::reference
