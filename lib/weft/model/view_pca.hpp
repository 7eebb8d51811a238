// A PCA per view (Sattler, Sarlette & Klein 2003, as Ruiters & Klein 2009 and Havran et al. 2010
// describe it): the images of one view direction are a matrix of their own, L C rows of P texels.
//
//   T[v, l, p, c] = mean[v, l, c] + sum_{j < k_v} A[o_v + j, p] B[o_v + j, l, c]    p = y X + x
//
// k_v = ranks[v], o_v = k_0 + ... + k_{v-1}: the components of all views lie behind each other, a
// view that holds fewer of them takes less room. A component is an image A[i] of the view and its
// weight B[i] under every light. The images have unit norm up to storage rounding; B carries the
// singular values, in descending order of |B[i]| within a view.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/model/index_tensor.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

struct ViewPcaModel final : Model {
  IndexTensor ranks;          // [V]
  std::vector<float> mean;    // [V, L, C]
  std::vector<float> images;  // A [K, P], K the sum of the ranks
  std::vector<float> basis;   // B [K, L, C]

  // o_v for every view, and K behind them.
  std::vector<std::size_t> offsets() const;

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& factors) override;
  void add_mean(std::span<const float> mean) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // The part that decodes to a selection; its mip level is not looked at.
  std::unique_ptr<ViewPcaModel> select(const Selection& selection) const;

  // The model of the next mip level, its images averaged over 2 x 2 texels, unrounded; null unless
  // the encoding is linear.
  std::unique_ptr<ViewPcaModel> next_mip_level() const;

  // From a validated file; throws an input error where the tensors do not fit each other.
  static std::unique_ptr<ViewPcaModel> read(const ModelFile& file);
};

}  // namespace weft
