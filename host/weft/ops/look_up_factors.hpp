// Look-ups in the models that are products of factors: kernels/look_up_factors.cl.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>

#include "weft/btf/lookup.hpp"
#include "weft/device/device.hpp"

namespace weft::ops {

// Rows of a factor are padded with zeros to whole vectors of 8 floats; this many of them.
inline constexpr std::size_t row_lanes = 8;
std::size_t row_vectors(std::size_t rank);

// Floats of `rows` such rows. Throws a run-time error that names `what` where they overflow.
std::size_t row_floats(std::size_t rows, std::size_t rank, const char* what);

// Puts `rows` rows of `rank` values, value(row, j), at the front of `to`, which is zero; or writes
// them to a buffer.
using RowValue = std::function<float(std::size_t row, std::size_t j)>;
void pad_rows(std::size_t rows, std::size_t rank, const RowValue& value, std::span<float> to);
void write_rows(Device& device, std::size_t rows, std::size_t rank, const RowValue& value,
                Buffer& to);

// `count` records of `lookup` into out, [count][C] floats, of a BTF of `shape`; with an order (see
// order_lookups.hpp) those records from `first` on, in that order, into the values from `first` on.
struct LookupBatch {
  LookupShape lookup;
  BtfShape shape;
  std::size_t count = 0;
  const Buffer& lookups;
  Buffer& out;
  std::size_t first = 0;
  const Buffer* order = nullptr;
};

// A: [P] rows, B: [V L C] rows, mean: [V L C].
void look_up_pca(Device& device, const LookupBatch& batch, std::size_t rank, const Buffer& A,
                 const Buffer& B, const Buffer& mean);

// views: [V][3] ulong: vectors of a row of the view's factors, the vector at which its A, [P] rows,
// begins, and that of its B, [L C] rows. mean: [V L C].
void look_up_view_pca(Device& device, const LookupBatch& batch, const Buffer& views,
                      const Buffer& A, const Buffer& B, const Buffer& mean);

// clusters: [P] uint; A: [P] rows; B: [clusters][V L C] rows; mean: [clusters][V L C].
void look_up_lpca(Device& device, const LookupBatch& batch, std::size_t rank,
                  const Buffer& clusters, const Buffer& A, const Buffer& B, const Buffer& mean);

// Flops of one look-up in a pca of that rank.
double look_up_flops(const LookupShape& lookup, std::size_t channels, std::size_t rank);

// "-DTEXELS=.. -DLOOKUPS=..": the options of kernels that include look_up_record.cl, and the
// look-ups that a work-item does.
std::string lookup_options(const Device& device, const LookupShape& lookup, std::size_t channels);
std::size_t lookup_block(const Device& device);

}  // namespace weft::ops
