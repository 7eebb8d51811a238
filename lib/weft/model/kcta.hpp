// Clustered tensor model (Tsai & Shih 2012, eq. (8)): slices along one mode m, each a mixture of K
// of C clusters, and each cluster a Tucker model of the whole tensor whose mode-m factor is sparse,
//
//   T = sum_c Z_c x_1 U_1,c x_2 U_2,c ... x_N U_N,c,    (U_m,c)_i* = 0 unless c is one of slice i's
//
// of the modes v, l, y, x, c or groups of them (see mode_groups.hpp). With K = 1 it is CTA. A mode
// n != m has one factor for all clusters (eq. (23)), one for each, or none: it is then an identity,
// and the cores are as long in it as the tensor. Clusters of views may be resampled: the views of a
// dense grid then have clusters and rows of the U_m,c too, beside those of the measured views.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/selection.hpp"
#include "weft/model/index_tensor.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/tucker.hpp"

namespace weft {

struct KctaModel final : Model {
  ModeGroups groups;
  std::size_t mode = 0;                    // m, a number of a group
  std::size_t clusters = 0;                // C
  std::size_t mixtures = 1;                // K
  std::vector<std::size_t> ranks;          // R_1 .. R_N, at least 1: sizes of every core
  IndexTensor members;                     // clusters of each slice, ascending: [I_m][K]
  std::vector<float> mixing;               // rows of U_m,c for them: [I_m][K][R_m]
  std::vector<float> cores;                // Z_c: [C][R_m][R_n of the others ...]
  std::size_t grid_side = 0;               // N of a grid of N x N views, or 0
  IndexTensor grid_members;                // clusters of its views, ascending: [N N][K]
  std::vector<float> grid_mixing;          // and rows of U_m,c for them: [N N][K][R_m]
  std::vector<std::vector<float>> global;  // U_n [I_n][R_n] of all clusters, or empty
  std::vector<std::vector<float>> local;   // U_n,c [C][I_n][R_n], or empty

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& scale) override;
  std::size_t view_grid() const override { return grid_side; }
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // Takes the groups, with identities for all modes; m is the group `clustered`.
  void set_groups(ModeGroups modes, std::size_t clustered);

  std::size_t slices() const { return groups.groups()[mode].size; }
  // Those of a grid of views come behind the measured ones, wherever a slice is asked for by
  // number.
  std::size_t all_slices() const { return slices() + grid_side * grid_side; }
  // Whether views alone are clustered, so that there can be a grid of them.
  bool clusters_views() const;
  bool has_factor(std::size_t n) const { return !global[n].empty() || !local[n].empty(); }
  // R_n of the modes n != m, in order; and their product.
  std::vector<std::size_t> other_ranks() const;
  std::size_t core_row() const;
  // U_n or U_n,c, [I_n][R_n]; empty for an identity.
  std::span<const float> factor(std::size_t n, std::size_t cluster) const;
  // The k-th cluster of a slice, and the row of U_m,c for it.
  std::size_t member(std::size_t slice, std::size_t k) const;
  std::span<const float> mixing_row(std::size_t slice, std::size_t k) const;

  // A cluster as a Tucker model of the whole tensor; rows of its mode m are 0 for slices that are
  // not its own.
  std::unique_ptr<TuckerModel> cluster(std::size_t c) const;

  // Products and sums of one fitted_texel with all its channels.
  std::size_t texel_operations() const;

  // The part that decodes to a selection, with the clusters that it needs; its mip level is not
  // looked at.
  std::unique_ptr<KctaModel> select(const Selection& selection) const;

  // From a validated file of codec kcta or cta; throws an input error where the tensors do not fit
  // each other.
  static std::unique_ptr<KctaModel> read(const ModelFile& file);

 private:
  bool channels_alone() const;
  std::vector<std::size_t> cores_shape() const;
  std::vector<std::size_t> mixing_shape() const;
  void read_grid(const ModelFile& file);
  // One texel at v, l, y, x, c: a number for each index of a channel mode that stands alone, else
  // one.
  std::vector<double> mixed(const std::array<std::size_t, mode_count>& at) const;
  // What `row` of mode n, or all of it where that is a channel mode that stands alone, makes of a
  // tensor [outer][R_n][inner].
  std::vector<double> contracted(const std::vector<double>& T, std::size_t outer, std::size_t inner,
                                 std::size_t n, std::size_t cluster, std::size_t row) const;

  std::vector<std::uint8_t> group_of_modes_;  // what the file says of the groups
  std::uint8_t clustered_ = 0;                // and of m
};

}  // namespace weft
