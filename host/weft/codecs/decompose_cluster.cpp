#include "weft/codecs/decompose_cluster.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "weft/reference/factorise.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using Sizes = std::vector<std::size_t>;

// The leading `rank` eigenvectors of a Gram matrix, [n][rank].
std::vector<float> leading(std::size_t n, std::span<const double> gram, std::size_t rank) {
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(n, gram);
  std::vector<float> U(n * rank);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < rank; ++j) {
      U[i * rank + j] = static_cast<float>(eigen.vectors[i * n + j]);
    }
  }
  return U;
}

std::vector<float> transposed(std::size_t rows, std::span<const float> M) {
  const std::size_t columns = M.size() / rows;
  std::vector<float> result(M.size());
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) result[j * rows + i] = M[i * columns + j];
  }
  return result;
}

}  // namespace

SliceShape::SliceShape(const KctaRequest& request) {
  groups.push_back(request.mode);
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    if (n != request.mode) groups.push_back(n);
  }
  for (const std::size_t n : groups) {
    const bool global = request.cuts(n) && request.global_mode[n] != 0;
    sizes.push_back(global ? request.ranks[n] : request.groups.groups()[n].size);
    ranks.push_back(request.ranks[n]);
  }
}

std::size_t SliceShape::row() const {
  return product(std::span(sizes).subspan(1));
}

std::size_t SliceShape::core_row() const {
  return product(std::span(ranks).subspan(1));
}

bool SliceShape::any_local() const {
  for (std::size_t a = 1; a < sizes.size(); ++a) {
    if (local(a)) return true;
  }
  return false;
}

std::vector<float> ClusterDecomposition::begin(ClusterBases& cluster, const RowList& slices) {
  const std::size_t count = slices.size();
  const std::size_t rank = std::min(shape_.ranks[0], count);
  cluster.U.assign(shape_.sizes.size(), {});
  std::vector<float> U_m =
      leading(count, row_products(device_, shape_.row(), slices, slices), rank);
  count_products(stage(), count, count, shape_.row());
  if (shape_.any_local()) {
    // mode by mode, of the tensor as projected so far
    HeldTensor T = onto_rows(slices, U_m);
    for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
      if (!shape_.local(a)) continue;
      cluster.U[a] = leading_basis(T, a);
      T = projected(T, a, cluster.U[a]);
    }
  }
  for (std::size_t s = 0; s < cold_sweeps; ++s) U_m = sweep(cluster, slices, U_m);
  return U_m;
}

std::vector<float> ClusterDecomposition::refine(ClusterBases& cluster, const RowList& slices,
                                                std::vector<float> U_m) {
  for (std::size_t s = 0; s < warm_sweeps; ++s) U_m = sweep(cluster, slices, U_m);
  return U_m;
}

// Each basis of the tensor projected onto all others, that of the slices last.
std::vector<float> ClusterDecomposition::sweep(ClusterBases& cluster, const RowList& slices,
                                               const std::vector<float>& U_m) {
  if (shape_.any_local()) {
    const HeldTensor W = onto_rows(slices, U_m);
    for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
      if (!shape_.local(a)) continue;
      std::optional<HeldTensor> T;
      for (std::size_t b = 1; b < shape_.sizes.size(); ++b) {
        if (b != a && shape_.local(b)) T = projected(T ? *T : W, b, cluster.U[b]);
      }
      cluster.U[a] = leading_basis(T ? *T : W, a);
    }
  }
  return decompose_slices(cluster, slices, U_m.size() / slices.size());
}

// slices x_m U_m^T
HeldTensor ClusterDecomposition::onto_rows(const RowList& slices, const std::vector<float>& U_m) {
  Sizes sizes = shape_.sizes;
  sizes[0] = U_m.size() / slices.size();
  count_sums(stage(), 0, sizes[0], slices.size(), shape_.row());
  HeldTensor W(std::move(sizes), FloatStore::Place::memory);
  combine_rows(device_, shape_.row(), {}, transposed(slices.size(), U_m), slices, W.values.data());
  return W;
}

HeldTensor ClusterDecomposition::projected(const HeldTensor& T, std::size_t axis,
                                           const std::vector<float>& U) {
  HeldTensor result = T.projected(device_, axis, shape_.ranks[axis], U);
  stage().flops +=
      2 * static_cast<double>(T.values.size()) * static_cast<double>(shape_.ranks[axis]);
  stage().bytes += static_cast<double>((T.values.size() + result.values.size()) * sizeof(float));
  return result;
}

std::vector<float> ClusterDecomposition::leading_basis(const HeldTensor& T, std::size_t axis) {
  const std::size_t size = shape_.sizes[axis];
  stage().flops += static_cast<double>(T.values.size() * (size + 1));
  stage().bytes += static_cast<double>(T.values.size() * sizeof(float));
  return leading(size, T.gram(device_, axis, Arithmetic::f32), shape_.ranks[axis]);
}

// The slices projected onto the bases of the other modes, their mixing matrix and the core.
std::vector<float> ClusterDecomposition::decompose_slices(ClusterBases& cluster,
                                                          const RowList& slices, std::size_t rank) {
  std::vector<RowProduct> steps;
  for (std::size_t a = 1; a < shape_.sizes.size(); ++a) {
    if (!shape_.local(a)) continue;
    steps.push_back({a - 1, ops::ModeProduct::project, shape_.ranks[a], cluster.U[a]});
  }
  const std::size_t count = slices.size();
  const std::size_t length = shape_.core_row();
  RowList onto = slices;
  if (!steps.empty()) {
    if (projected_.size() < count * length) projected_.resize(count * length);
    const Sizes sizes(shape_.sizes.begin() + 1, shape_.sizes.end());
    count_modes(stage(), count, sizes, steps);
    multiply_modes(device_, sizes, slices, steps, projected_.data());
    onto = row_list(projected_, count, length);
  }
  std::vector<float> U_m = leading(count, row_products(device_, length, onto, onto), rank);
  cluster.Z.assign(rank * length, 0.0f);
  combine_rows(device_, length, {}, transposed(count, U_m), onto, cluster.Z.data());
  count_products(stage(), count, count, length);
  count_sums(stage(), 0, rank, count, length);
  cluster.Z.resize(product(shape_.ranks), 0.0f);  // fewer slices than ranks
  return U_m;
}

}  // namespace weft
