#include "numerics/bounds.hpp"

#include <algorithm>
#include <cmath>

namespace weft::numerics {
namespace {

// Rounding errors of `terms` operations one after the other: their signs are taken as independent
// (Higham & Mary 2019), so that they grow with the root of their number; 4 for any probability that
// matters. The bound for the worst signs has terms in the place of 4 sqrt(terms).
double roundings(double terms, double u) {
  return 4 * std::sqrt(terms) * u;
}

}  // namespace

double roundoff(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? 0x1p-24 : 0x1p-53;
}

Bounds bounds_of(const Case& what, const Matrix& matrix, const ReferenceSvd& truth,
                 SvdMethod method, Arithmetic arithmetic) {
  const double u = roundoff(arithmetic);
  const double K = static_cast<double>(matrix.rows);
  const double m = static_cast<double>(matrix.columns);
  const std::vector<double>& sigma = truth.values;
  Bounds bounds;
  if (sigma[0] == 0) return bounds;
  double squares = 0;
  for (const double value : sigma) squares += value * value;
  const double norm = std::sqrt(squares) / sigma[0];  // |X| in units of sigma_1, as all below

  // What every path does at its end: V rounded to the arithmetic, products X V with sums of m terms
  // in blocks of 240 at most, and inner products of their columns in double (ops/gram.hpp), for
  // the worst signs.
  const double products =
      2 * norm * (roundings(std::min(m, 240.0) + m / 240 + 2, u) + roundings(m, u));
  const double chunk = std::min(K, 512.0) + K / (64 * 512) + 66;
  const double inner = chunk * 0x1p-53;
  const double common = products + inner;
  // Directions below this are given up as noise.
  double floor = 4 * u * norm;
  // sigma_j^2 falls by `squared` at most, sigma_j by `plain`
  double squared = 0;
  double plain = 0;
  switch (method) {
    case SvdMethod::gram: {
      // X^T X + E: sums of blocks of 240 rows within blocks of the stream. The leading eigenvectors
      // hold of each sigma_j^2 all but 2 |E|.
      const double blocks = K / 240 + K / 300;
      squared = 2 * roundings(std::min(K, 240.0) + blocks + 2, u) * norm * norm;
      break;
    }
    case SvdMethod::qr: {
      // R of X + E, as in ops/tsqr.hpp: m reflectors per block that a row goes through, each with
      // sums of 64 + K / 128 terms and some 14 operations more
      const double rows = std::min(K, 1024.0);
      const double batches = std::ceil(K / 8192);
      const double reductions = std::min(batches, 16.0) + (K > 1024 ? 3 : 0) + batches / 16;
      plain = 2 * norm * roundings(m * reductions * (std::min(rows, 64.0) + rows / 128 + 14), u);
      break;
    }
    default: {
      // Inner products W^T W are in double whatever the arithmetic, and hold nothing below the root
      // of its roundoff; iterations end where the residual is 1e-6 (f32) or 1e-14 (f64), or no
      // longer falls, at the rounding of the products.
      const double columns = std::min(2.0 * static_cast<double>(what.rank) + 24, m);
      floor = std::max(floor, std::sqrt(columns * 0x1p-52));
      squared = 2 * columns * roundings(chunk, 0x1p-53);
      plain = (arithmetic == Arithmetic::f32 ? 1e-6 : 1e-14) * norm + products;
    }
  }

  double lost = 0;  // squares of what is not found
  for (std::size_t j = 0; j < what.rank && j < sigma.size(); ++j) {
    const double s = sigma[j] / sigma[0];
    double kept = std::sqrt(std::max(s * s - squared, 0.0)) - plain - common;
    if (kept <= floor) kept = 0;
    bounds.value = std::max(bounds.value, s - kept);
    lost += s * s - kept * kept;
  }
  // values may be too large as well, and noise may be kept
  bounds.value = std::max(bounds.value, plain + common);
  bounds.reconstruction = std::sqrt(lost) / norm + common;
  // s - sqrt(s^2 - squared) - plain - common <= s / 10
  bounds.resolved = std::max({std::sqrt(squared / 0.1), 20 * (plain + common), 1.2 * floor});
  if (what.leading > 0) {
    const std::size_t k = what.leading;
    const double last = sigma[k - 1] / sigma[0];
    const double next = k < sigma.size() ? sigma[k] / sigma[0] : 0.0;
    // Wedin; of X^T X, with the gap of squares
    bounds.subspace = 2 * (plain + common) / (last - next) + squared / (last * last - next * next) +
                      roundings(m, u);
  }
  return bounds;
}

}  // namespace weft::numerics
