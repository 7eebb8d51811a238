// From the codes of sparse coding to the lists that a sparse model stores.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "weft/model/sparse.hpp"

namespace weft {

// Codes [rows][length]: coefficients of zero are no terms, whatever their index.
struct CodeLists {
  std::size_t length = 0;
  std::vector<std::uint32_t> indices;
  std::vector<double> coefficients;
};

// The norm of each atom's coefficients: of a row of P (section 4.1).
std::vector<double> atom_weights(const CodeLists& codes, std::size_t atoms);

// Drops atoms of weight zero: renumbers the others in `codes`, drops their weights, and returns
// their old numbers.
std::vector<std::uint32_t> drop_unused(CodeLists& codes, std::vector<double>& weights);

// Ascending lists of min(length, atoms) terms, each filled up with coefficients of zero at its
// lowest unused indices.
SparseLists sparse_lists(const CodeLists& codes, std::size_t atoms);

}  // namespace weft
