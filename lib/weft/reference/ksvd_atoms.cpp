#include "weft/reference/ksvd_atoms.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/random.hpp"

namespace weft::reference {
namespace {

// Errors below this part of a signal's square are rounding of float.
constexpr double rounding = 0x1p-40;

// Scales to norm 1, whatever the magnitude; false for zero.
bool normalise(std::span<double> values) {
  double largest = 0;
  for (const double value : values) largest = std::max(largest, std::abs(value));
  if (largest == 0) return false;
  double square = 0;
  for (double& value : values) {
    value /= largest;
    square += value * value;
  }
  for (double& value : values) value /= std::sqrt(square);
  return true;
}

double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

void random_atom(std::uint64_t seed, std::span<double> atom) {
  std::vector<float> values(atom.size());
  for (std::uint64_t attempt = 0;; ++attempt) {
    fill_random(splitmix64(seed, attempt), values);
    std::copy(values.begin(), values.end(), atom.begin());
    if (normalise(atom)) return;
  }
}

}  // namespace

void check_ksvd(std::size_t signals, std::size_t dimension, const KsvdOptions& options,
                std::size_t given_values) {
  if (signals == 0 || dimension == 0) {
    fail_input("K-SVD of {} signals of dimension {}", signals, dimension);
  }
  if (options.atoms == 0 || options.sparsity == 0) {
    fail_input("K-SVD with {} atoms, {} of them per signal", options.atoms, options.sparsity);
  }
  if (options.atoms > std::numeric_limits<std::uint32_t>::max()) {
    fail_input("K-SVD with {} atoms: more than an index of 32 bits counts", options.atoms);
  }
  if (!(options.tolerance >= 0)) fail_input("K-SVD with a tolerance of {}", options.tolerance);
  const bool given = options.start == KsvdStart::given;
  if (given && (given_values / dimension != options.atoms || given_values % dimension != 0)) {
    fail_input("K-SVD starts from a dictionary of {} values where {} x {} are asked for",
               given_values, options.atoms, dimension);
  }
}

std::vector<double> initial_atoms(const SignalReader& signals, const KsvdOptions& options,
                                  std::span<const double> given) {
  const std::size_t n = signals.dimension;
  for (std::size_t i = 0; options.start == KsvdStart::given && i < given.size(); ++i) {
    if (!std::isfinite(given[i])) {
      fail_input("K-SVD starts from a dictionary whose atom {} has {} in dimension {}", i / n,
                 given[i], i % n);
    }
  }
  std::vector<double> dictionary(options.atoms * n);
  // the atoms share the signals out between them; each takes one of its part
  const std::size_t parts = std::min(options.atoms, signals.signals);
  for (std::size_t j = 0; j < options.atoms; ++j) {
    const std::span<double> atom = std::span(dictionary).subspan(j * n, n);
    bool found = false;
    if (options.start == KsvdStart::given) {
      std::copy_n(given.begin() + static_cast<std::ptrdiff_t>(j * n), n, atom.begin());
      found = normalise(atom);
    } else if (options.start == KsvdStart::samples && j < parts) {
      const std::size_t size = signals.signals / parts;
      const std::size_t extra = signals.signals % parts;
      const std::size_t begin = j * size + std::min(j, extra);
      const std::size_t count = size + (j < extra ? 1 : 0);
      const std::size_t first = splitmix64(options.seed, j) % count;
      for (std::size_t i = 0; i < count && !found; ++i) {
        signals.read(begin + (first + i) % count, atom);
        found = normalise(atom);
      }
    }
    if (!found) random_atom(splitmix64(~options.seed, j), atom);
  }
  return dictionary;
}

std::size_t replace_atoms(const SignalReader& signals, std::span<const double> errors,
                          const std::vector<bool>& needless, std::span<double> dictionary) {
  const auto wanted = static_cast<std::size_t>(std::count(needless.begin(), needless.end(), true));
  if (wanted == 0) return 0;
  const std::size_t n = signals.dimension;
  // the worst first, a few for every atom since some are alike
  std::vector<std::size_t> order(signals.signals);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const std::size_t tried = wanted < order.size() / 8 ? 8 * wanted : order.size();
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(tried), order.end(),
                    [&](std::size_t a, std::size_t b) {
                      return errors[a] != errors[b] ? errors[a] > errors[b] : a < b;
                    });
  std::vector<std::size_t> placed;
  std::vector<double> candidate(n);
  std::size_t next = 0;
  for (std::size_t j = 0; j < needless.size(); ++j) {
    if (!needless[j]) continue;
    for (bool found = false; !found; ++next) {
      if (next == tried || errors[order[next]] == 0) return placed.size();
      signals.read(order[next], candidate);
      const double square = dot(candidate, candidate);
      if (!(errors[order[next]] > rounding * square) || !normalise(candidate)) continue;
      found = std::none_of(placed.begin(), placed.end(), [&](std::size_t atom) {
        return std::abs(dot(candidate, dictionary.subspan(atom * n, n))) > duplicate_atoms;
      });
      if (!found) continue;
      std::copy(candidate.begin(), candidate.end(),
                dictionary.begin() + static_cast<std::ptrdiff_t>(j * n));
      placed.push_back(j);
    }
  }
  return placed.size();
}

}  // namespace weft::reference
