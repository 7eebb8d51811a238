#include "weft/reference/batch_omp.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"

namespace weft::reference {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index(std::size_t i) {
  return static_cast<Eigen::Index>(i);
}

// The least squares solution on some atoms, and the distance of the last one from the others' span.
struct Solution {
  Eigen::VectorXd x;
  double last_distance = 0;
};
Solution solve(const Eigen::MatrixXd& chosen, const Eigen::VectorXd& y) {
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(chosen);
  const Eigen::Index last = chosen.cols() - 1;
  Solution solution;
  // More atoms than dimensions always depend on each other.
  if (chosen.cols() > chosen.rows()) return solution;
  solution.last_distance = std::abs(qr.matrixQR()(last, last));
  if (solution.last_distance > PursuitLimits::least_distance) solution.x = qr.solve(y);
  return solution;
}

// The pursuit of one signal among unit atoms, the rows of `units`; zero rows are no atoms.
struct Pursuit {
  std::vector<Eigen::Index> support;
  Eigen::VectorXd x;
  Eigen::VectorXd residual;
};
Pursuit pursue(const RowMajor& units, const Eigen::VectorXd& y, const OmpTarget& target) {
  Pursuit pursuit;
  pursuit.residual = y;
  Eigen::MatrixXd chosen(y.size(), 0);
  std::vector<bool> usable(static_cast<std::size_t>(units.rows()), true);
  const double smallest = PursuitLimits::smallest_correlation * y.norm();
  std::size_t dependent = 0;
  while (pursuit.support.size() < target.sparsity && dependent < PursuitLimits::most_dependent &&
         pursuit.residual.norm() > target.residual) {
    // the atom that explains most of what is left
    const Eigen::VectorXd correlations = units * pursuit.residual;
    Eigen::Index best = -1;
    double largest = smallest;
    for (Eigen::Index n = 0; n < units.rows(); ++n) {
      if (usable[static_cast<std::size_t>(n)] && std::abs(correlations[n]) > largest) {
        largest = std::abs(correlations[n]);
        best = n;
      }
    }
    if (best < 0) break;
    usable[static_cast<std::size_t>(best)] = false;
    // least squares on it and those before
    chosen.conservativeResize(Eigen::NoChange, chosen.cols() + 1);
    chosen.rightCols(1) = units.row(best).transpose();
    Solution solution = solve(chosen, y);
    if (solution.x.size() == 0) {
      chosen.conservativeResize(Eigen::NoChange, chosen.cols() - 1);
      ++dependent;
      continue;
    }
    dependent = 0;
    pursuit.support.push_back(best);
    pursuit.x = std::move(solution.x);
    pursuit.residual = y - chosen * pursuit.x;
  }
  return pursuit;
}

}  // namespace

SparseCodes batch_omp(std::size_t atoms, std::size_t dimension, std::span<const double> D,
                      std::span<const double> Y, const OmpTarget& target) {
  if (atoms == 0 || dimension == 0 || D.size() / dimension != atoms || D.size() % dimension != 0 ||
      Y.size() % dimension != 0) {
    fail_input(
        "sparse coding: {} values of signals and {} of a dictionary are not whole rows of {}",
        Y.size(), D.size(), dimension);
  }
  RowMajor units = Eigen::Map<const RowMajor>(D.data(), index(atoms), index(dimension));
  std::vector<double> norms(atoms);
  for (std::size_t n = 0; n < atoms; ++n) {
    norms[n] = units.row(index(n)).stableNorm();
    if (norms[n] > 0 && std::isfinite(norms[n])) {
      units.row(index(n)) /= norms[n];
    } else {
      units.row(index(n)).setZero();
    }
  }
  const std::size_t signals = Y.size() / dimension;
  const std::size_t k = target.sparsity;
  SparseCodes codes{k, std::vector<std::uint32_t>(signals * k, 0),
                    std::vector<double>(signals * k, 0.0), std::vector<std::uint32_t>(signals, 0),
                    std::vector<double>(signals, std::numeric_limits<double>::quiet_NaN())};
  for (std::size_t s = 0; s < signals; ++s) {
    const Eigen::Map<const Eigen::VectorXd> y(Y.data() + s * dimension, index(dimension));
    Pursuit pursuit;
    if (y.allFinite()) {
      pursuit = pursue(units, y, target);
      codes.residuals[s] = pursuit.residual.norm();
    }
    const std::size_t count = pursuit.support.size();
    codes.counts[s] = static_cast<std::uint32_t>(count);
    std::vector<bool> chosen(atoms, false);
    for (std::size_t j = 0; j < count; ++j) {
      const auto n = static_cast<std::size_t>(pursuit.support[j]);
      chosen[n] = true;
      codes.indices[s * k + j] = static_cast<std::uint32_t>(n);
      codes.coefficients[s * k + j] = pursuit.x[index(j)] / norms[n];
    }
    // fill up with atoms that were not chosen
    std::size_t unused = 0;
    for (std::size_t j = count; j < k; ++j) {
      while (unused < atoms && chosen[unused]) ++unused;
      if (unused == atoms) break;
      codes.indices[s * k + j] = static_cast<std::uint32_t>(unused++);
    }
  }
  return codes;
}

}  // namespace weft::reference
