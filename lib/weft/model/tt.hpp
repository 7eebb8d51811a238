// Tensor train (Oseledets 2011) of a BTF, as Ballester-Ripoll & Pajarola 2016 use it (section 3):
//
//   T[i1, i2, i3, i4, i5] = G1[i1, :] G2[:, i2, :] G3[:, i3, :] G4[:, i4, :] G5[:, i5]
//
// where i1 .. i5 are the indices x, y, c, v, l in the model's order of modes; core n is
// [R_{n-1}, I_n, R_n] with R_0 = R_5 = 1. All ranks are at least 1: an all-zero tensor has cores of
// zeros.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "weft/btf/modes.hpp"
#include "weft/btf/selection.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

struct TtModel final : Model {
  ModeOrder order{Mode::column, Mode::row, Mode::channel, Mode::view, Mode::light};
  std::array<std::size_t, mode_count + 1> ranks{1, 1, 1, 1, 1, 1};  // R_0 .. R_5
  std::array<std::vector<float>, mode_count> cores;                 // [R_{n-1}, I_n, R_n]
  // Each core as half with a scale per component, or float.
  std::array<Storage, mode_count> stored{};

  // I_n of core n.
  std::size_t size(std::size_t n) const { return mode_size(info.btf.shape, order[n]); }
  // Where in the order a mode is.
  std::size_t position(Mode mode) const;
  // Numbers in all cores.
  std::size_t coefficients() const;

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& factors) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;
  // Products and sums of one fitted_texel with all its channels.
  std::size_t texel_operations() const;

  // The part that decodes to a selection, slices of the cores; its mip level is not looked at.
  std::unique_ptr<TtModel> select(const Selection& selection) const;

  // The next mip level: averages of neighbouring slices of the rows' and of the columns' core. Null
  // unless the encoding is linear.
  std::unique_ptr<TtModel> next_mip_level() const;

  // From a validated file; throws an input error where the tensors do not fit each other.
  static std::unique_ptr<TtModel> read(const ModelFile& file);

 private:
  std::vector<std::size_t> core_shape(std::size_t n) const;
  std::string core_name(std::size_t n) const;
};

}  // namespace weft
