#include "numerics/errors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/reference/factorise.hpp"

namespace weft::numerics {
namespace {

// |(I - V_k V_k^T) W_k|, the largest singular value: the sine of the largest angle between the
// leading k columns of V (m x m) and those of W (m x rank).
double sine_of_angle(std::size_t m, const std::vector<double>& V, const std::vector<double>& W,
                     std::size_t rank, std::size_t k) {
  if (rank < k) return 1;
  std::vector<double> rest(m * k);
  for (std::size_t c = 0; c < k; ++c) {
    for (std::size_t i = 0; i < m; ++i) rest[i * k + c] = W[i * rank + c];
    for (std::size_t l = 0; l < k; ++l) {
      double product = 0;
      for (std::size_t i = 0; i < m; ++i) product += V[i * m + l] * W[i * rank + c];
      for (std::size_t i = 0; i < m; ++i) rest[i * k + c] -= product * V[i * m + l];
    }
  }
  return reference::thin_svd(m, k, rest).values[0];
}

// |X - XV V^T| / |X| of 2^exponent X.
double reconstruction_error(const Matrix& matrix, const Computed& computed) {
  const std::size_t rank = computed.rank;
  double squares = 0;
  double errors = 0;
  for (std::size_t i = 0; i < matrix.rows; ++i) {
    for (std::size_t j = 0; j < matrix.columns; ++j) {
      const double value = std::ldexp(matrix.values[i * matrix.columns + j], computed.exponent);
      double sum = 0;
      for (std::size_t l = 0; l < rank; ++l) {
        sum += computed.XV[i * rank + l] * computed.V[j * rank + l];
      }
      squares += value * value;
      errors += (value - sum) * (value - sum);
    }
  }
  return squares > 0 ? std::sqrt(errors / squares) : 0;
}

}  // namespace

Errors compare(const Case& what, const Matrix& matrix, const ReferenceSvd& truth,
               const Computed& computed) {
  Errors errors;
  errors.rank = computed.rank;
  const double first = truth.values[0];
  bool resolving = true;
  errors.resolved = 1;
  for (std::size_t j = 0; j < std::max(what.rank, computed.rank); ++j) {
    const double sigma = j < truth.values.size() ? truth.values[j] : 0.0;
    const double value = j < computed.rank
                             ? std::ldexp(computed.values[j], truth.exponent - computed.exponent)
                             : 0.0;
    const double error = std::abs(value - sigma);
    if (first > 0) {
      errors.value = std::max(errors.value, error / first);
    } else if (error > 0) {
      errors.value = std::numeric_limits<double>::infinity();
    }
    // what is below the reference's own rounding is zero
    if (sigma <= first * 0x1p-60) continue;
    errors.relative = std::max(errors.relative, error / sigma);
    resolving = resolving && error <= 0.1 * sigma;
    if (resolving) errors.resolved = sigma / first;
  }
  if (what.leading > 0) {
    errors.subspace =
        sine_of_angle(matrix.columns, truth.V, computed.V, computed.rank, what.leading);
  }
  errors.reconstruction = reconstruction_error(matrix, computed);
  return errors;
}

}  // namespace weft::numerics
