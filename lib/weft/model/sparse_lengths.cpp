#include "weft/model/sparse_lengths.hpp"

#include <algorithm>
#include <cmath>

namespace weft {
namespace {

// What an atom adds to those before, as a part of its norm, below which it is taken as dependent.
constexpr double dependent = 1e-5;

double dot(std::span<const double> a, std::span<const double> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

std::vector<double> truncation_errors(std::size_t dimension, std::span<const float> Y,
                                      std::span<const float> D, const CodeLists& codes,
                                      std::size_t most_signals) {
  const std::size_t signals = dimension > 0 ? Y.size() / dimension : 0;
  const std::size_t looked_at = std::min(signals, most_signals);
  std::vector<double> errors(codes.length + 1, 0.0);
  std::vector<double> residual(dimension);
  std::vector<double> basis(codes.length * dimension);
  double all_squares = 0;
  for (const float value : Y) all_squares += double{value} * double{value};
  for (std::size_t n = 0; n < looked_at; ++n) {
    const std::size_t s = n * signals / looked_at;
    std::copy_n(Y.data() + s * dimension, dimension, residual.data());
    double square = dot(residual, residual);
    errors[0] += square;
    std::size_t columns = 0;
    for (std::size_t m = 0; m < codes.length; ++m) {
      // the part of the term's atom that is orthogonal to those before
      const std::size_t term = s * codes.length + m;
      if (codes.coefficients[term] != 0) {
        const std::span<double> q = std::span(basis).subspan(columns * dimension, dimension);
        std::copy_n(D.data() + codes.indices[term] * dimension, dimension, q.data());
        const double length = std::sqrt(dot(q, q));
        for (int round = 0; round < 2; ++round) {
          for (std::size_t b = 0; b < columns; ++b) {
            const std::span<const double> other =
                std::span(basis).subspan(b * dimension, dimension);
            const double part = dot(other, q);
            for (std::size_t i = 0; i < dimension; ++i) q[i] -= part * other[i];
          }
        }
        const double left = std::sqrt(dot(q, q));
        if (left > dependent * length) {
          for (double& value : q) value /= left;
          const double part = dot(q, residual);
          for (std::size_t i = 0; i < dimension; ++i) residual[i] -= part * q[i];
          square = std::min(square, dot(residual, residual));
          ++columns;
        }
      }
      errors[m + 1] += square;
    }
  }
  if (errors[0] > 0) {
    const double whole = all_squares / errors[0];
    for (double& error : errors) error *= whole;
  }
  return errors;
}

std::vector<SparseLengthChoice> best_lengths(std::span<const double> view_errors,
                                             std::span<const double> texel_errors,
                                             const LengthBytes& bytes) {
  std::vector<SparseLengthChoice> all;
  for (std::size_t k1 = 1; k1 < view_errors.size(); ++k1) {
    for (std::size_t k2 = 1; k2 < texel_errors.size(); ++k2) {
      all.push_back({k1, k2, view_errors[k1] + texel_errors[k2], bytes(k1, k2)});
    }
  }
  std::ranges::stable_sort(all, [](const SparseLengthChoice& a, const SparseLengthChoice& b) {
    return a.bytes < b.bytes || (a.bytes == b.bytes && a.squares < b.squares);
  });
  std::vector<SparseLengthChoice> best;
  for (const SparseLengthChoice& choice : all) {
    if (best.empty() || choice.squares < best.back().squares) best.push_back(choice);
  }
  return best;
}

}  // namespace weft
