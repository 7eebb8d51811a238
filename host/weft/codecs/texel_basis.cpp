#include "weft/codecs/texel_basis.hpp"

#include <algorithm>
#include <cmath>

#include "weft/reference/factorise.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

// Columns below this part of the others hold nothing but float rounding.
constexpr double dependent = 1e-5;

// Rows [count][columns]: each column less its mean, to unit length; false for those that are zero.
std::vector<bool> centre_and_scale(std::size_t count, std::size_t columns,
                                   std::vector<double>& rows) {
  std::vector<bool> used(columns, false);
  for (std::size_t j = 0; j < columns; ++j) {
    double mean = 0;
    double before = 0;
    for (std::size_t i = 0; i < count; ++i) {
      mean += rows[i * columns + j];
      before += rows[i * columns + j] * rows[i * columns + j];
    }
    mean /= static_cast<double>(count);
    double square = 0;
    for (std::size_t i = 0; i < count; ++i) {
      rows[i * columns + j] -= mean;
      square += rows[i * columns + j] * rows[i * columns + j];
    }
    // what is left of a constant column is rounding
    used[j] = square > before * dependent * dependent;
    const double factor = used[j] ? 1.0 / std::sqrt(square) : 0.0;
    for (std::size_t i = 0; i < count; ++i) rows[i * columns + j] *= factor;
  }
  return used;
}

// An orthonormal basis [count][k] of the centred columns, filled up with random ones; columns past
// its rank are zero.
std::vector<double> cluster_basis(std::size_t count, std::size_t k, std::vector<double> rows,
                                  std::uint64_t seed) {
  const std::size_t wanted = std::min(k, count - 1);
  centre_and_scale(count, k, rows);
  reference::Orthonormal basis = reference::orthonormal_basis(count, k, rows, dependent);
  std::vector<double> result(count * k, 0.0);
  std::size_t rank = std::min(basis.rank, wanted);
  const auto keep = [&](const reference::Orthonormal& from, std::size_t columns) {
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < columns; ++j) result[i * k + j] = from.Q[i * from.rank + j];
    }
  };
  keep(basis, rank);
  if (rank == wanted) return result;

  // random columns without their part in the basis, then all together once more
  std::vector<float> random(count * (wanted - rank));
  reference::fill_random(seed, random);
  std::vector<double> all(count * wanted);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j < rank; ++j) all[i * wanted + j] = result[i * k + j];
    for (std::size_t j = rank; j < wanted; ++j) {
      all[i * wanted + j] = random[i * (wanted - rank) + j - rank];
    }
  }
  for (int round = 0; round < 2; ++round) {
    for (std::size_t j = rank; j < wanted; ++j) {
      for (std::size_t b = 0; b < rank; ++b) {
        double product = 0;
        for (std::size_t i = 0; i < count; ++i) {
          product += all[i * wanted + b] * all[i * wanted + j];
        }
        for (std::size_t i = 0; i < count; ++i) {
          all[i * wanted + j] -= product * all[i * wanted + b];
        }
      }
    }
    centre_and_scale(count, wanted, all);
  }
  basis = reference::orthonormal_basis(count, wanted, all, dependent);
  keep(basis, std::min(basis.rank, wanted));
  return result;
}

}  // namespace

std::vector<float> texel_basis(std::span<const std::uint32_t> labels, std::size_t clusters,
                               std::size_t k, std::span<const float> coefficients,
                               std::uint64_t seed) {
  std::vector<std::vector<std::size_t>> members(clusters);
  for (std::size_t p = 0; p < labels.size(); ++p) members[labels[p]].push_back(p);
  std::vector<float> U(labels.size() * k, 0.0f);
  for (std::size_t g = 0; g < clusters; ++g) {
    const std::size_t count = members[g].size();
    if (count < 2 || k == 0) continue;
    std::vector<double> rows(count * k);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < k; ++j) rows[i * k + j] = coefficients[members[g][i] * k + j];
    }
    const std::vector<double> basis =
        cluster_basis(count, k, std::move(rows), reference::splitmix64(seed, g));
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < k; ++j) {
        U[members[g][i] * k + j] = static_cast<float>(basis[i * k + j]);
      }
    }
  }
  return U;
}

std::size_t fill_empty_clusters(std::span<std::uint32_t> labels, std::size_t clusters,
                                std::span<const float> errors) {
  std::vector<std::size_t> sizes(clusters, 0);
  std::vector<double> sums(clusters, 0.0);
  for (std::size_t p = 0; p < labels.size(); ++p) {
    ++sizes[labels[p]];
    sums[labels[p]] += errors[p];
  }
  std::size_t filled = 0;
  for (std::size_t empty = 0; empty < clusters; ++empty) {
    if (sizes[empty] > 0) continue;
    // the worst that can be split
    std::size_t worst = clusters;
    for (std::size_t g = 0; g < clusters; ++g) {
      if (sizes[g] >= 2 && sums[g] > 0 && (worst == clusters || sums[g] > sums[worst])) worst = g;
    }
    if (worst == clusters) break;
    // its worst half, ties by texel
    std::vector<std::size_t> members;
    for (std::size_t p = 0; p < labels.size(); ++p) {
      if (labels[p] == worst) members.push_back(p);
    }
    std::stable_sort(members.begin(), members.end(),
                     [&](std::size_t a, std::size_t b) { return errors[a] > errors[b]; });
    members.resize(members.size() / 2);
    for (const std::size_t p : members) {
      labels[p] = static_cast<std::uint32_t>(empty);
      sums[empty] += errors[p];
      sums[worst] -= errors[p];
    }
    sizes[empty] = members.size();
    sizes[worst] -= members.size();
    ++filled;
  }
  return filled;
}

}  // namespace weft
