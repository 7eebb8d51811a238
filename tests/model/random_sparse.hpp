// Sparse models made of random lists, for tests of their decoders.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "support/generators.hpp"
#include "weft/model/sparse.hpp"

namespace weft::test {

struct SparseSizes {
  std::size_t light_atoms = 0;  // D1
  std::size_t abrdf_atoms = 0;  // D2
  std::size_t view_terms = 0;   // k1
  std::size_t texel_terms = 0;  // k2
};

// Lists of ascending indices below `atoms`, some of their coefficients zero.
inline SparseLists random_lists(std::size_t rows, std::size_t length, std::size_t atoms,
                                std::uint64_t seed, double size = 1.0) {
  Random random(seed);
  SparseLists lists;
  lists.length = length;
  std::vector<std::uint32_t> indices;
  std::vector<std::uint32_t> all(atoms);
  std::iota(all.begin(), all.end(), 0U);
  for (std::size_t row = 0; row < rows; ++row) {
    // the first `length` of a random order
    for (std::size_t i = 0; i < length; ++i) std::swap(all[i], all[i + random.index(atoms - i)]);
    std::vector<std::uint32_t> list(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(length));
    std::sort(list.begin(), list.end());
    indices.insert(indices.end(), list.begin(), list.end());
    for (std::size_t i = 0; i < length; ++i) {
      const double value = random.index(5) == 0 ? 0.0 : random.uniform(-size, size);
      lists.coefficients.push_back(static_cast<float>(value));
    }
  }
  lists.atoms = IndexTensor(indices, atoms);
  return lists;
}

inline SparseModel random_sparse(const BtfShape& shape, const SparseSizes& sizes,
                                 double size = 1.0) {
  SparseModel model;
  model.info.codec = "sparse";
  model.info.btf = make_info(shape, DType::f16);
  model.light_atoms = sizes.light_atoms;
  model.abrdf_atoms = sizes.abrdf_atoms;
  model.mean = random_floats(shape.images() * shape.channels, 1, -size, size);
  model.dictionary =
      random_floats(sizes.light_atoms * shape.lights * shape.channels, 2, -size, size);
  model.views =
      random_lists(sizes.abrdf_atoms * shape.views, sizes.view_terms, sizes.light_atoms, 3);
  model.texels = random_lists(shape.texels(), sizes.texel_terms, sizes.abrdf_atoms, 4);
  return model;
}

// The same lists with the magnitudes of all numbers: decoding it gives the sum of the terms'
// magnitudes.
inline SparseModel magnitude_of(const SparseModel& model) {
  SparseModel result = model;
  for (auto* values : {&result.mean, &result.dictionary, &result.views.coefficients,
                       &result.texels.coefficients}) {
    for (float& value : *values) value = std::abs(value);
  }
  return result;
}

}  // namespace weft::test
