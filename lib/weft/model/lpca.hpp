// Local PCA, or per-cluster factorisation (Mueller, Meseth & Klein 2003, as Ruiters & Klein 2009
// describe it): the texels are clustered, and each cluster has a mean ABRDF and a basis of its own.
//
//   T[v, l, p, c] = mean[g, v, l, c] + sum_{j < k_g} A[p, j] B[o_g + j, v, l, c]
//
//   g = clusters[p]    k_g = ranks[g]    o_g = k_0 + ... + k_{g-1}    p = y X + x
//
// A texel takes k terms however many clusters there are. Within a cluster A's columns are
// orthonormal up to storage rounding; B carries the singular values, in descending order of |B[i]|.
// A has as many columns as the largest rank; a cluster of a lower one leaves its last columns zero.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/model/index_tensor.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

struct LpcaModel final : Model {
  std::size_t rank = 0;             // k, the largest of the ranks
  IndexTensor clusters;             // [P]
  IndexTensor ranks;                // [G], G the number of clusters
  std::vector<float> mean;          // [G, V, L, C]
  std::vector<float> coefficients;  // A [P, k]
  std::vector<float> basis;         // B [K, V, L, C], K the sum of the ranks

  // o_g for every cluster, and K behind them.
  std::vector<std::size_t> offsets() const;

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& factors) override;
  void add_mean(std::span<const float> mean) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // The part that decodes to a selection, without clusters that none of its texels is in; its mip
  // level is not looked at.
  std::unique_ptr<LpcaModel> select(const Selection& selection) const;

  // From a validated file; throws an input error where the tensors do not fit each other.
  static std::unique_ptr<LpcaModel> read(const ModelFile& file);
};

}  // namespace weft
