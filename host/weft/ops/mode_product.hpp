// Mode-n products and mode-n Gram matrices of tensors on the device, without unfolding them.
//
// A tensor is row-major floats; seen from its mode n it is [outer][n][inner], where `outer` is the
// product of the sizes before the mode and `inner` that of those behind it (K-CTA paper, eq. (2);
// Kolda & Bader 2009):
//
//   (T x_n U^T)(o, r, i) = sum_j U(j, r) T(o, j, i)        project, onto the columns of U
//   (T x_n U)(o, j, i)   = sum_r U(j, r) T(o, r, i)        expand, from them
//   G(j, k)              = sum_{o, i} T(o, j, i) T(o, k, i)
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/ops/syrk_rows.hpp"

namespace weft::ops {

// A tensor as its mode n sees it.
struct ModeView {
  std::size_t outer = 1;
  std::size_t size = 1;
  std::size_t inner = 1;

  std::size_t elements() const { return outer * size * inner; }
};
ModeView mode_view(std::span<const std::size_t> sizes, std::size_t mode);

enum class ModeProduct { project, expand };

// out = T x_n U^T or T x_n U for a row-major factor U [I][R]: T has the size I and out R in mode n,
// or the other way round. Where the mode is last that is one product; where neighbours behind it
// fill vectors, strips of T go through kernels/mode_product.cl on CPU devices; else it is a batch
// of `outer` products. |error| <= gamma(product_terms(size of T in mode n)) |U| |T|.
void mode_product(Device& device, const ModeView& view, const Buffer& T, ModeProduct kind,
                  const Buffer& U, std::size_t other_size, Buffer& out);
// Bytes that it holds beside.
std::size_t mode_product_bytes(const Device& device, const ModeView& view, std::size_t other_size);

// Sums of rows that lie anywhere in memory that the device reads, on CPU devices:
//
//   out(i, p) = base(base_at[i] + p) + sum_j M(i, j) rows(row_at[j] + p)
//
// The buffers must outlive it; without `base` that is 0.
class RowSums {
 public:
  RowSums(Device& device, const Buffer& rows, std::span<const cl_ulong> row_at, const Buffer* base,
          std::span<const cl_ulong> base_at, std::span<const float> M, std::size_t count);
  // Columns [first, first + width), [count][width].
  void columns(std::size_t first, std::size_t width, Buffer& out);

 private:
  Device& device_;
  const Buffer& rows_;
  const Buffer* base_;
  std::size_t count_;
  std::size_t terms_;
  Buffer row_at_, base_at_;
  Buffer packed_;  // M
};

// The mode-n Gram matrix of a tensor that comes in parts; the sums of each part are those of
// syrk() in the given arithmetic, and the parts are added in double.
class ModeGram {
 public:
  ModeGram(Device& device, std::size_t size, Arithmetic arithmetic);

  // Adds a part; its view has the size of the mode. T must live until the device is done with it.
  void add(const Buffer& T, const ModeView& view);

  // size x size, symmetric. Waits for the device.
  const std::vector<double>& matrix();

  // Bytes that it holds on the device and here, for parts of at most `rows` = outer inner.
  static std::size_t bytes(const Device& device, std::size_t size, std::size_t rows,
                           Arithmetic arithmetic);

 private:
  void add_packed(const Buffer& T, const ModeView& view, const Result& C);
  void add_waiting();

  Device& device_;
  std::size_t size_;
  Arithmetic arithmetic_;
  Buffer product_;           // of parts that were not added yet
  std::size_t waiting_ = 0;  // how many
  RowScratch scratch_;
  std::size_t scratch_rows_ = 0;  // that it is for
  std::vector<double> matrix_;
};

}  // namespace weft::ops
