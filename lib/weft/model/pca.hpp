// PCA of the texel x (view, light, channel) unfolding with the mean ABRDF removed (Ruiters & Klein
// 2009, sections 2.1 and 4.1):
//
//   T[v, l, p, c] = mean[v, l, c] + sum_{j < k} A[p, j] B[j, v, l, c]        p = y X + x
//
// A's columns are orthonormal up to storage rounding; B carries the singular values, in descending
// order of |B[j]|.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

struct PcaModel final : Model {
  std::size_t rank = 0;             // k; 0 for data that is its mean
  std::vector<float> mean;          // [V, L, C]
  std::vector<float> coefficients;  // A [P, k]
  std::vector<float> basis;         // B [k, V, L, C]

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& factors) override;
  void add_mean(std::span<const float> mean) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // The part that decodes to a selection; its mip level is not looked at.
  std::unique_ptr<PcaModel> select(const Selection& selection) const;

  // The model of the next mip level, its coefficients averaged over 2 x 2 texels, unrounded; null
  // unless the encoding is linear.
  std::unique_ptr<PcaModel> next_mip_level() const;

  // From a validated file; throws an input error where the tensors do not fit each other.
  static std::unique_ptr<PcaModel> read(const ModelFile& file);
};

}  // namespace weft
