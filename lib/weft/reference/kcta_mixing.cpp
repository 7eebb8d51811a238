#include "weft/reference/kcta_mixing.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft {
namespace reference {
namespace {

using Sizes = std::vector<std::size_t>;
using Values = std::vector<double>;

double squares_of(std::span<const double> values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
}

std::span<const double> row_of(std::span<const double> matrix, std::size_t row,
                               std::size_t columns) {
  return matrix.subspan(row * columns, columns);
}

// Powers of the positive eigenvalues of a Gram matrix, 0 for those that count as 0: its
// Moore-Penrose inverse with -1, and the root of that with -1/2.
Values power(std::size_t n, std::span<const double> gram, double exponent) {
  const SymmetricEigen eigen = symmetric_eigen(n, gram);
  const double least = mixing_cutoff * std::max(0.0, eigen.values[0]);
  Values result(n * n, 0.0);
  for (std::size_t k = 0; k < n; ++k) {
    if (!(eigen.values[k] > least)) continue;
    const double scaled = std::pow(eigen.values[k], exponent);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        result[i * n + j] += scaled * eigen.vectors[i * n + k] * eigen.vectors[j * n + k];
      }
    }
  }
  return result;
}

}  // namespace

Values row_products(std::size_t length, std::span<const double> A, std::span<const double> B) {
  const Sizes sizes{A.size() / length, length};
  return mode_product(sizes, 1, A, B.size() / length, B);
}

Values matrix_product(std::size_t n, std::span<const double> A, std::span<const double> B) {
  const Sizes sizes{n, B.size() / n};
  return mode_product(sizes, 0, B, A.size() / n, A);
}

Values projected(Sizes& sizes, std::span<const double> T, std::span<const Values> U,
                 std::size_t but) {
  Values values(T.begin(), T.end());
  for (std::size_t n = 1; n < sizes.size(); ++n) {
    if (n == but || U[n - 1].empty()) continue;
    const std::size_t rank = U[n - 1].size() / sizes[n];
    values = mode_product(sizes, n, values, rank, transposed(sizes[n], rank, U[n - 1]));
    sizes[n] = rank;
  }
  return values;
}

Values KctaCluster::rows() const {
  Sizes left = sizes;
  Values T = Z;
  for (std::size_t n = 1; n < sizes.size(); ++n) {
    if (U[n - 1].empty()) continue;
    const std::size_t size = U[n - 1].size() / sizes[n];
    T = mode_product(left, n, T, size, U[n - 1]);
    left[n] = size;
  }
  return T;
}

Values solve_mixing(std::size_t n, std::span<const double> gram, std::span<const double> products) {
  if (n == 0) return {};
  return matrix_product(n, products, power(n, gram, -1.0));
}

KctaMixing mix_slices(std::span<const std::size_t> sizes, std::span<const double> A,
                      std::span<const KctaCluster> clusters, std::size_t mixtures) {
  const std::size_t slices = sizes[0];
  const std::size_t C = clusters.size();
  const std::size_t R = clusters[0].sizes[0];
  const std::size_t core_row = clusters[0].Z.size() / R;
  const std::size_t row = A.size() / slices;

  // What does not change in the stage: the dual bases (7), the slices' projections onto them and
  // onto the cores, and the same of all clusters' cores (14), (19).
  std::vector<Values> V(C), first(C), a(C);
  std::vector<Values> dual(C * C), f(C * C);  // of Z_j^(c), at c C + j
  for (std::size_t c = 0; c < C; ++c) {
    const KctaCluster& cluster = clusters[c];
    V[c] =
        matrix_product(R, power(R, row_products(core_row, cluster.Z, cluster.Z), -0.5), cluster.Z);
    Sizes left(sizes.begin(), sizes.end());
    const Values onto = projected(left, A, cluster.U);
    first[c] = row_products(core_row, onto, V[c]);
    a[c] = row_products(core_row, onto, cluster.Z);
    for (std::size_t j = 0; j < C; ++j) {
      Sizes core = clusters[j].sizes;
      Values Z = clusters[j].Z;
      for (std::size_t n = 1; n < core.size(); ++n) {
        if (cluster.U[n - 1].empty()) continue;
        const Sizes factor{sizes[n], core[n]};
        const Values across =
            mode_product(factor, 0, clusters[j].U[n - 1], core[n],
                         transposed(sizes[n], core[n], cluster.U[n - 1]));  // U_n,c^T U_n,j
        Z = mode_product(core, n, Z, core[n], across);
      }
      dual[c * C + j] = row_products(core_row, Z, V[c]);
      f[c * C + j] = row_products(core_row, Z, cluster.Z);
    }
  }

  KctaMixing mixing;
  mixing.members.resize(slices * mixtures);
  mixing.coefficients.resize(slices * mixtures * R);
  mixing.errors.resize(slices);
  for (std::size_t i = 0; i < slices; ++i) {
    std::vector<std::size_t> chosen;
    Values u;      // coefficients for them, [k][R]
    Values right;  // a_mi, eq. (18)
    for (std::size_t k = 0; k < mixtures; ++k) {
      // greedy search: (9), (13)
      std::size_t best = C;
      double largest = 0;
      for (std::size_t c = 0; c < C; ++c) {
        if (std::find(chosen.begin(), chosen.end(), c) != chosen.end()) continue;
        Values left(row_of(first[c], i, R).begin(), row_of(first[c], i, R).end());
        for (std::size_t j = 0; j < chosen.size(); ++j) {
          const Values made = matrix_product(R, row_of(u, j, R), dual[c * C + chosen[j]]);
          for (std::size_t r = 0; r < R; ++r) left[r] -= made[r];
        }
        const double found = squares_of(left);
        if (best == C || found > largest) {
          best = c;
          largest = found;
        }
      }
      chosen.push_back(best);
      // optimal projection: (15)-(19); block (p, q) of (17) is f_q(Z_p^(q))
      const auto of = row_of(a[best], i, R);
      right.insert(right.end(), of.begin(), of.end());
      const std::size_t n = chosen.size() * R;
      Values gram(n * n);
      for (std::size_t p = 0; p < chosen.size(); ++p) {
        for (std::size_t q = 0; q < chosen.size(); ++q) {
          const Values& block = f[chosen[q] * C + chosen[p]];
          for (std::size_t r = 0; r < R; ++r) {
            std::copy_n(block.begin() + static_cast<std::ptrdiff_t>(r * R), R,
                        gram.begin() + static_cast<std::ptrdiff_t>((p * R + r) * n + q * R));
          }
        }
      }
      u = solve_mixing(n, gram, right);
    }
    const double squares = squares_of(A.subspan(i * row, row));
    mixing.errors[i] =
        std::max(0.0, squares - std::inner_product(u.begin(), u.end(), right.begin(), 0.0));
    // in ascending order
    std::vector<std::size_t> order(mixtures);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(),
              [&](std::size_t p, std::size_t q) { return chosen[p] < chosen[q]; });
    for (std::size_t k = 0; k < mixtures; ++k) {
      mixing.members[i * mixtures + k] = static_cast<std::uint32_t>(chosen[order[k]]);
      std::copy_n(
          u.begin() + static_cast<std::ptrdiff_t>(order[k] * R), R,
          mixing.coefficients.begin() + static_cast<std::ptrdiff_t>((i * mixtures + k) * R));
    }
  }
  return mixing;
}

KctaMixing mix_between(const ViewResampling& views, std::span<const std::size_t> sizes,
                       std::span<const double> A, std::span<const KctaCluster> clusters,
                       std::size_t mixtures) {
  const std::size_t row = A.size() / sizes[0];
  constexpr std::size_t at_once = 256;
  KctaMixing all;
  for (std::size_t first = 0; first < views.size(); first += at_once) {
    check_interrupt();
    const std::size_t count = std::min(at_once, views.size() - first);
    Values slices(count * row, 0.0);
    for (std::size_t e = 0; e < count; ++e) {
      const std::vector<double> w = views.weights(first + e);
      for (std::size_t v = 0; v < w.size(); ++v) {
        for (std::size_t p = 0; p < row; ++p) slices[e * row + p] += w[v] * A[v * row + p];
      }
    }
    Sizes block(sizes.begin(), sizes.end());
    block[0] = count;
    const KctaMixing part = mix_slices(block, slices, clusters, mixtures);
    all.members.insert(all.members.end(), part.members.begin(), part.members.end());
    all.coefficients.insert(all.coefficients.end(), part.coefficients.begin(),
                            part.coefficients.end());
    all.errors.insert(all.errors.end(), part.errors.begin(), part.errors.end());
  }
  return all;
}

}  // namespace reference

void set_mixing(KctaModel& model, std::size_t mixtures, std::size_t given,
                std::span<const std::uint32_t> members, std::span<const float> coefficients) {
  const std::size_t rank = model.ranks[model.mode];
  std::vector<std::uint32_t> numbers;
  model.mixtures = mixtures;
  model.mixing.clear();
  for (std::size_t i = 0; i < model.slices(); ++i) {
    const auto own = members.subspan(i * given, given);
    std::vector<std::uint32_t> all(own.begin(), own.end());
    for (std::uint32_t c = 0; all.size() < mixtures; ++c) {
      if (std::find(own.begin(), own.end(), c) == own.end()) all.push_back(c);
    }
    std::sort(all.begin(), all.end());
    for (const std::uint32_t c : all) {
      numbers.push_back(c);
      const auto found = std::find(own.begin(), own.end(), c);
      for (std::size_t r = 0; r < rank; ++r) {
        const auto k = static_cast<std::size_t>(found - own.begin());
        model.mixing.push_back(found == own.end() ? 0.0f
                                                  : coefficients[(i * given + k) * rank + r]);
      }
    }
  }
  model.members = IndexTensor(numbers, model.clusters);
}

void set_grid(KctaModel& model, std::size_t side, const reference::KctaMixing& mixing) {
  model.grid_side = side;
  model.grid_members = IndexTensor(mixing.members, model.clusters);
  model.grid_mixing.assign(mixing.coefficients.begin(), mixing.coefficients.end());
}

}  // namespace weft
