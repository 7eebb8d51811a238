// Products of many long rows in host memory or files on a device, in blocks of columns: slices of a
// tensor against the rows of its clusters. Blocks are functions of the sizes alone; sums over
// columns are added up in double, so that their length costs no accuracy.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/job.hpp"
#include "weft/ops/mode_product.hpp"

namespace weft {

// Where rows of one length begin, all in one array; they need not be neighbours.
using RowList = std::vector<const float*>;

RowList row_list(std::span<const float> values, std::size_t rows, std::size_t length);
// Those of a list with the given numbers.
RowList picked(const RowList& rows, std::span<const std::size_t> numbers);

// A B^T, [a][b].
std::vector<double> row_products(Device& device, std::size_t length, const RowList& A,
                                 const RowList& B);

// out = base + M rows with M [out][rows] row-major, rows of `out` one behind the other; without
// `base` it is M rows.
void combine_rows(Device& device, std::size_t length, const RowList& base, std::span<const float> M,
                  const RowList& rows, float* out);

// Squared norms of the rows of base + M rows.
std::vector<double> combined_squares(Device& device, std::size_t length, const RowList& base,
                                     std::span<const float> M, const RowList& rows);

// One mode of rows that are tensors, onto a factor U [I][R] or from it.
struct RowProduct {
  std::size_t axis;  // among the sizes of a row
  ops::ModeProduct kind;
  std::size_t other_size;
  const std::vector<float>& factor;
};

// Rows, tensors of these sizes, multiplied in one mode after the other; they come one behind the
// other.
void multiply_modes(Device& device, std::vector<std::size_t> sizes, const RowList& rows,
                    std::span<const RowProduct> products, float* out);

// What they add to a stage: flops, and the values that they read and write once. Products A B^T of
// so many rows each; `out` sums of `rows` rows, with `base` more read beside; rows in mode after
// mode.
void count_products(Stage& stage, std::size_t a, std::size_t b, std::size_t length);
void count_sums(Stage& stage, std::size_t base, std::size_t out, std::size_t rows,
                std::size_t length);
void count_modes(Stage& stage, std::size_t rows, std::vector<std::size_t> sizes,
                 std::span<const RowProduct> products);

// Most bytes that any of them holds beside, for so many rows (of both operands) of such a length,
// which products make no longer than `longest`.
std::size_t row_products_bytes(const Device& device, std::size_t rows, std::size_t longest);

}  // namespace weft
