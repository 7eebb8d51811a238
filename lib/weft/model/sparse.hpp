// Sparse tensor decomposition (Ruiters & Klein 2009, section 3.3 and eq. (2)), with the mean ABRDF
// removed:
//
//   T[v, l, p, c] = mean[v, l, c] + sum_j P[j, p] sum_i V[i, v, j] L[c, l, i]        p = y X + x
//
// L is a dictionary of D1 atoms, reflectance over light and colour. V says how each of D2 ABRDFs is
// combined from them for each view, with at most k1 atoms, and P how each texel is combined from
// the ABRDFs, with at most k2 of them. Both are lists of equal length, an index and a coefficient
// for each term; indices ascend strictly, and a list of fewer terms has coefficients of zero. A
// value takes k1 k2 products.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/model/index_tensor.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

// Sparse rows: `length` terms each.
struct SparseLists {
  std::size_t length = 0;           // k
  IndexTensor atoms;                // [rows, k]
  std::vector<float> coefficients;  // [rows, k]
};

struct SparseModel final : Model {
  std::size_t light_atoms = 0;    // D1
  std::size_t abrdf_atoms = 0;    // D2; 0 for data that is its mean
  std::vector<float> mean;        // [V, L, C]
  std::vector<float> dictionary;  // L [D1, L, C]
  SparseLists views;              // V: rows [D2, V] of k1 indices below D1
  SparseLists texels;             // P: rows [P] of k2 indices below D2

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  void divide(const Weights& factors) override;
  void add_mean(std::span<const float> mean) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;

  // The part that decodes to a selection, without atoms that are in none of its lists; its mip
  // level is not looked at.
  std::unique_ptr<SparseModel> select(const Selection& selection) const;

  // From a validated file; throws an input error where the tensors do not fit each other or a list
  // is not in order.
  static std::unique_ptr<SparseModel> read(const ModelFile& file);
};

}  // namespace weft
