#include "weft/model/sparse_lists.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace weft {

std::vector<double> atom_weights(const CodeLists& codes, std::size_t atoms) {
  std::vector<double> weights(atoms, 0.0);
  for (std::size_t i = 0; i < codes.indices.size(); ++i) {
    weights[codes.indices[i]] += codes.coefficients[i] * codes.coefficients[i];
  }
  for (double& weight : weights) weight = std::sqrt(weight);
  return weights;
}

std::vector<std::uint32_t> drop_unused(CodeLists& codes, std::vector<double>& weights) {
  std::vector<std::uint32_t> kept;
  std::vector<std::uint32_t> number(weights.size(), 0);
  for (std::size_t atom = 0; atom < weights.size(); ++atom) {
    if (weights[atom] == 0) continue;
    number[atom] = static_cast<std::uint32_t>(kept.size());
    weights[kept.size()] = weights[atom];
    kept.push_back(static_cast<std::uint32_t>(atom));
  }
  weights.resize(kept.size());
  for (std::size_t i = 0; i < codes.indices.size(); ++i) {
    const bool term = codes.coefficients[i] != 0;
    codes.indices[i] = term ? number[codes.indices[i]] : 0;
  }
  return kept;
}

SparseLists sparse_lists(const CodeLists& codes, std::size_t atoms) {
  SparseLists lists;
  lists.length = std::min(codes.length, atoms);
  std::vector<std::uint32_t> indices;
  std::vector<std::pair<std::uint32_t, double>> list;
  for (std::size_t first = 0; codes.length > 0 && first < codes.indices.size();
       first += codes.length) {
    list.clear();
    for (std::size_t i = first; i < first + codes.length; ++i) {
      if (codes.coefficients[i] != 0) list.emplace_back(codes.indices[i], codes.coefficients[i]);
    }
    std::sort(list.begin(), list.end());
    const std::size_t terms = list.size();
    std::size_t behind = 0;  // first term at or behind the index
    for (std::uint32_t index = 0; list.size() < lists.length; ++index) {
      if (behind < terms && list[behind].first == index) {
        ++behind;
      } else {
        list.emplace_back(index, 0.0);
      }
    }
    std::sort(list.begin(), list.end());
    for (const auto& [index, coefficient] : list) {
      indices.push_back(index);
      lists.coefficients.push_back(static_cast<float>(coefficient));
    }
  }
  lists.atoms = IndexTensor(indices, atoms);
  return lists;
}

}  // namespace weft
