#include "weft/codecs/mix_slices.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {
namespace {

// Of pseudoinverses.
constexpr std::size_t most_kept_bytes = std::size_t{16} << 20;

// A^power of an n x n Gram matrix, 0 where its eigenvalues count as 0.
std::vector<double> gram_power(std::size_t n, std::span<const double> gram, double power) {
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(n, gram);
  const double least = mixing_cutoff * std::max(0.0, eigen.values[0]);
  std::vector<double> result(n * n, 0.0);
  for (std::size_t k = 0; k < n; ++k) {
    if (!(eigen.values[k] > least)) continue;
    const double scale = std::pow(eigen.values[k], power);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        result[i * n + j] += scale * eigen.vectors[i * n + k] * eigen.vectors[j * n + k];
      }
    }
  }
  return result;
}

}  // namespace

SliceMixer::SliceMixer(std::size_t clusters, std::size_t mixtures, std::span<const double> gram)
    : clusters_(clusters), mixtures_(mixtures), gram_(gram) {
  const auto side = static_cast<std::size_t>(std::lround(std::sqrt(gram.size())));
  rank_ = side / clusters;
  for (std::size_t c = 0; c < clusters; ++c) {
    std::vector<double> block;
    for (std::size_t r = 0; r < rank_; ++r) {
      const auto row = gram.subspan((c * rank_ + r) * columns() + c * rank_, rank_);
      block.insert(block.end(), row.begin(), row.end());
    }
    roots_.push_back(gram_power(rank_, block, -0.5));
  }
}

// The objective of (9) and (13).
double SliceMixer::explained_by(std::size_t cluster, std::span<const double> a) const {
  const std::size_t first = cluster * rank_;
  std::vector<double> left(a.begin() + static_cast<std::ptrdiff_t>(first),
                           a.begin() + static_cast<std::ptrdiff_t>(first + rank_));
  for (std::size_t p = 0; p < rows_.size(); ++p) {
    const double* row = gram_.data() + rows_[p] * columns() + first;
    for (std::size_t r = 0; r < rank_; ++r) left[r] -= u_[p] * row[r];
  }
  double found = 0;
  for (std::size_t r = 0; r < rank_; ++r) {
    double sum = 0;
    for (std::size_t s = 0; s < rank_; ++s) sum += left[s] * roots_[cluster][s * rank_ + r];
    found += sum * sum;
  }
  return found;
}

// (15)-(18)
void SliceMixer::project(std::span<const double> a) {
  const std::size_t n = rows_.size();
  if (inverses_.size() * n * n * sizeof(double) > most_kept_bytes) inverses_.clear();
  std::vector<double>& inverse = inverses_[chosen_];
  if (inverse.empty()) {
    std::vector<double> G;
    for (const std::size_t p : rows_) {
      for (const std::size_t q : rows_) G.push_back(gram_[p * columns() + q]);
    }
    inverse = gram_power(n, G, -1);
  }
  u_.assign(n, 0.0);
  for (std::size_t p = 0; p < n; ++p) {
    for (std::size_t q = 0; q < n; ++q) u_[q] += a[rows_[p]] * inverse[p * n + q];
  }
}

double SliceMixer::mix(std::span<const double> a, reference::KctaMixing& mixing) {
  chosen_.clear();
  rows_.clear();
  u_.clear();
  for (std::size_t k = 0; k < mixtures_; ++k) {
    std::size_t best = clusters_;
    double largest = 0;
    for (std::size_t c = 0; c < clusters_; ++c) {
      if (std::find(chosen_.begin(), chosen_.end(), c) != chosen_.end()) continue;
      const double found = explained_by(c, a);
      if (best == clusters_ || found > largest) {
        best = c;
        largest = found;
      }
    }
    chosen_.push_back(best);
    for (std::size_t r = 0; r < rank_; ++r) rows_.push_back(best * rank_ + r);
    project(a);
  }
  std::vector<std::size_t> order(mixtures_);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t p, std::size_t q) { return chosen_[p] < chosen_[q]; });
  for (const std::size_t k : order) {
    mixing.members.push_back(static_cast<std::uint32_t>(chosen_[k]));
    const auto first = u_.begin() + static_cast<std::ptrdiff_t>(k * rank_);
    mixing.coefficients.insert(mixing.coefficients.end(), first,
                               first + static_cast<std::ptrdiff_t>(rank_));
  }
  double explained = 0;
  for (std::size_t p = 0; p < rows_.size(); ++p) explained += u_[p] * a[rows_[p]];
  return explained;
}

reference::KctaMixing mix_by_products(std::size_t clusters, std::size_t mixtures,
                                      std::span<const double> products,
                                      std::span<const double> gram,
                                      std::span<const double> squares) {
  SliceMixer mixer(clusters, mixtures, gram);
  reference::KctaMixing mixing;
  for (std::size_t i = 0; i < squares.size(); ++i) {
    const double explained =
        mixer.mix(products.subspan(i * mixer.columns(), mixer.columns()), mixing);
    mixing.errors.push_back(std::max(0.0, squares[i] - explained));
  }
  return mixing;
}

reference::KctaMixing mix_between(const ViewResampling& views, std::size_t clusters,
                                  std::size_t mixtures, std::span<const double> products,
                                  std::span<const double> gram) {
  SliceMixer mixer(clusters, mixtures, gram);
  reference::KctaMixing mixing;
  std::vector<double> a(mixer.columns());
  constexpr std::size_t interrupted_every = 4096;
  for (std::size_t e = 0; e < views.size(); ++e) {
    if (e % interrupted_every == 0) check_interrupt();
    const std::vector<double> w = views.weights(e);
    std::fill(a.begin(), a.end(), 0.0);
    for (std::size_t v = 0; v < w.size(); ++v) {
      const double* row = products.data() + v * a.size();
      for (std::size_t j = 0; j < a.size(); ++j) a[j] += w[v] * row[j];
    }
    mixer.mix(a, mixing);
  }
  return mixing;
}

}  // namespace weft
