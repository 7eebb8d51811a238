// Tucker model, or N-mode SVD (Vasilescu & Terzopoulos 2004, eq. (1); the K-CTA paper's section
// 3.2): a core and a factor per mode,
//
//   T = Z x_1 U_1 x_2 U_2 ... x_N U_N
//
// of the modes v, l, y, x, c or groups of them (see mode_groups.hpp). A mode without a factor is an
// identity: the core is then as long in it as the tensor. With the texels whole, this is
// TensorTextures' T = Z x_1 U_texel, eq. (6).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/selection.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"
#include "weft/tensor/float_store.hpp"

namespace weft {

struct TuckerModel final : Model {
  ModeGroups groups;
  std::vector<std::size_t> ranks;           // R_1 .. R_N, at least 1: sizes of the core
  FloatStore core;                          // Z [R_1]...[R_N]
  std::vector<std::vector<float>> factors;  // U_n [I_n][R_n], or empty for an identity

  bool has_factor(std::size_t n) const { return !factors[n].empty(); }

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& scale) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // Takes the groups, with identities for all factors; the core is left to the caller.
  void set_groups(ModeGroups modes);

  // Numbers in core and factors.
  std::size_t coefficients() const;
  // Products and sums of one fitted_texel with all its channels, counted exactly.
  std::size_t texel_operations() const;

  // The part that decodes to a selection, rows of the factors or slices of the core; its mip level
  // is not looked at.
  std::unique_ptr<TuckerModel> select(const Selection& selection) const;

  // From a validated file; throws an input error where the tensors do not fit each other.
  static std::unique_ptr<TuckerModel> read(const ModelFile& file);

 private:
  // Whether channels are a mode of their own.
  bool channels_alone() const;
  // Modes with a factor, but for channels that stand alone, in the order that fitted_texel
  // contracts them.
  std::vector<std::size_t> contraction_order() const;
  // One texel at v, l, y, x, c: a number for each slice of a channel mode that stands alone, else
  // one.
  std::vector<double> contracted(const std::array<std::size_t, mode_count>& at) const;

  std::vector<std::uint8_t> group_of_modes_;  // of v, l, y, x, c: what the file says of the groups
};

}  // namespace weft
