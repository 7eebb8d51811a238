// What models of grouped modes share: how a file says which modes are merged, which rows of each
// group a selection keeps, and by what they are divided.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/selection.hpp"
#include "weft/btf/weights.hpp"
#include "weft/model/model_file.hpp"

namespace weft {

// The group of each of v, l, y, x, c: the tensor "modes" of a file.
std::vector<std::uint8_t> group_numbers(const ModeGroups& groups);

// The groups that a file's tensor "modes" makes of its shape. Throws an input error that names both
// for numbers that make none or are in another order.
ModeGroups read_groups(const ModelFile& file);

// Indices of each group that a selection keeps, in its order; its mip level is not looked at.
std::vector<std::vector<std::size_t>> kept_rows(const ModeGroups& groups, const BtfShape& shape,
                                                const Selection& selection);

// Rows `rows` of mode n of a row-major tensor [outer][n][inner].
std::vector<float> take_rows(std::span<const float> T, std::size_t outer, std::size_t n,
                             std::size_t inner, std::span<const std::size_t> rows);

// What each index of a group is to be divided by, the product of the factors of its modes; empty
// where they are all 1. Throws a run-time error that names the codec where rows and columns are
// apart and factors of texels no products of both.
std::vector<std::vector<double>> group_divisors(const ModeGroups& groups, const BtfShape& shape,
                                                const Weights& factors, std::string_view codec);

}  // namespace weft
