#include "weft/ops/mode_product.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <string>

#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/ops/syrk.hpp"

namespace weft::ops {
namespace {

// Rows of an unfolding that are packed at a time: whole blocks of a product that stay in the
// caches.
std::size_t rows_at_once(const Device& device, std::size_t size, std::size_t rows,
                         Arithmetic arithmetic) {
  constexpr std::size_t most_packed_bytes = std::size_t{8} << 20;
  constexpr std::size_t granule = 3840;
  const std::size_t row_bytes = packed_elements(device, 1, size, arithmetic) * size_of(arithmetic);
  return std::min(rows,
                  std::max<std::size_t>(1, most_packed_bytes / row_bytes / granule) * granule);
}

// Neighbours behind a mode that fill vectors where they lie; fewer are packed.
constexpr std::size_t enough_inner = 32;

// Parts of a Gram matrix that wait to be added: a mebibyte of them.
std::size_t waiting_parts(std::size_t size) {
  constexpr std::size_t most_values = std::size_t{1} << 18;
  return std::max<std::size_t>(1, most_values / (size * size));
}

// Whether the rows of an unfolding are multiplied where they lie.
bool has_long_rows(const Device& device, const ModeView& view) {
  return device.limits().is_cpu && view.inner >= enough_inner && view.size <= most_long_rows;
}

bool in_strips(const Device& device, std::size_t inner) {
  return device.limits().is_cpu && inner >= enough_inner;
}

std::size_t micro_rows(const Device& device) {
  return vector_width(device) * sizeof(float) == 64 ? 8 : 4;
}

// How strips of so many rows are cut, and the programs for them.
struct Strips {
  std::size_t width;
  std::size_t count;  // of a work-item
  std::string options;

  Strips(const Device& device, std::size_t rows) : width(panel_width(device)) {
    // Half of a second cache of 512 KiB, in runs of rows of up to eight strips.
    constexpr std::size_t held_values = std::size_t{1} << 16;
    const std::size_t depth = device.parameter(tunables::gemm, "KC");
    count = std::clamp<std::size_t>(held_values / (width * std::min(depth, rows)), 1, 8);
    options = fmt::format("{} -DKC={} -DVALUES={}", vector_option(device), depth,
                          std::max(held_values, depth * width));
  }
};

// U(r, j) in `U` at r row + j column, rows x n.
Buffer packed_rows(Device& device, const Strips& strips, const Buffer& U, std::size_t rows,
                   std::size_t n, std::size_t row, std::size_t column) {
  const std::size_t panels = ceil_div(rows, micro_rows(device));
  Buffer packed(device, panels * micro_rows(device) * n * sizeof(float), "packed factor");
  const cl_kernel pack = device.kernel(kernel_sources::mode_product, strips.options, "pack_rows");
  set_arguments(pack, ulong(rows), ulong(n), U, ulong(row), ulong(column), packed);
  launch_items(device, pack, panels);
  return packed;
}

void strip_product(Device& device, const ModeView& view, const Buffer& T, const Buffer& U,
                   std::size_t rows, std::size_t row, std::size_t column, Buffer& out) {
  const Strips strips(device, view.size);
  const Buffer packed = packed_rows(device, strips, U, rows, view.size, row, column);
  const cl_kernel kernel =
      device.kernel(kernel_sources::mode_product, strips.options, "mode_product");
  set_arguments(kernel, ulong(view.size), ulong(view.inner), ulong(rows), ulong(strips.count), T,
                packed, out);
  launch_items(device, kernel, ceil_div(view.inner, strips.count * strips.width), view.outer);
}

Buffer table_of(Device& device, std::span<const cl_ulong> entries) {
  Buffer buffer(device, std::max<std::size_t>(entries.size_bytes(), sizeof(cl_ulong)),
                "places of rows");
  if (!entries.empty()) device.write(buffer, entries);
  return buffer;
}

}  // namespace

ModeView mode_view(std::span<const std::size_t> sizes, std::size_t mode) {
  ModeView view;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    (i < mode ? view.outer : i == mode ? view.size : view.inner) *= sizes[i];
  }
  return view;
}

void mode_product(Device& device, const ModeView& view, const Buffer& T, ModeProduct kind,
                  const Buffer& U, std::size_t other_size, Buffer& out) {
  const bool projects = kind == ModeProduct::project;
  const std::size_t columns = projects ? other_size : view.size;  // of U
  if (view.inner == 1) {
    gemm(device, Transpose::no, projects ? Transpose::no : Transpose::yes, view.outer, other_size,
         view.size, 1.0, {T, view.size}, {U, columns}, 0.0, {out, other_size});
    return;
  }
  if (in_strips(device, view.inner)) {
    strip_product(device, view, T, U, other_size, projects ? 1 : columns, projects ? columns : 1,
                  out);
    return;
  }
  ProductOptions options;
  options.batch = view.outer;
  gemm(device, projects ? Transpose::yes : Transpose::no, Transpose::no, other_size, view.inner,
       view.size, 1.0, {U, columns}, {T, view.inner, 0, view.size * view.inner}, 0.0,
       {out, view.inner, 0, other_size * view.inner}, options);
}

std::size_t mode_product_bytes(const Device& device, const ModeView& view, std::size_t other_size) {
  ProductOptions options;
  if (view.inner == 1) return product_bytes(device, other_size, view.size, options);
  if (in_strips(device, view.inner)) {
    return round_up(other_size, micro_rows(device)) * view.size * sizeof(float);
  }
  options.batch = view.outer;
  return product_bytes(device, view.inner, view.size, options);
}

RowSums::RowSums(Device& device, const Buffer& rows, std::span<const cl_ulong> row_at,
                 const Buffer* base, std::span<const cl_ulong> base_at, std::span<const float> M,
                 std::size_t count)
    : device_(device),
      rows_(rows),
      base_(base),
      count_(count),
      terms_(row_at.size()),
      row_at_(table_of(device, row_at)),
      base_at_(table_of(device, base_at)) {
  Buffer matrix(device, M.size_bytes(), "matrix of rows");
  device.write(matrix, M);
  packed_ = packed_rows(device, Strips(device, terms_), matrix, count_, terms_, terms_, 1);
}

void RowSums::columns(std::size_t first, std::size_t width, Buffer& out) {
  const Strips strips(device_, terms_);
  const cl_kernel kernel = device_.kernel(kernel_sources::mode_product,
                                          strips.options + " -DGATHERED=1", "combine_rows");
  set_arguments(kernel, ulong(terms_), ulong(width), ulong(count_), ulong(strips.count), rows_,
                packed_, out, row_at_, base_ != nullptr ? *base_ : rows_, base_at_,
                cl_uint{base_ != nullptr ? 1U : 0U}, ulong(first));
  launch_items(device_, kernel, ceil_div(width, strips.count * strips.width));
}

ModeGram::ModeGram(Device& device, std::size_t size, Arithmetic arithmetic)
    : device_(device), size_(size), arithmetic_(arithmetic), matrix_(size * size, 0.0) {
  require_arithmetic(device, arithmetic);
  product_ = Buffer(device, waiting_parts(size) * size * size * size_of(arithmetic),
                    "Gram matrices of a mode");
}

void ModeGram::add(const Buffer& T, const ModeView& view) {
  const std::size_t rows = view.outer * view.inner;
  if (rows == 0) return;
  if (waiting_ == waiting_parts(size_)) add_waiting();
  const Result C = to_row_major(device_, product_, size_, waiting_ * size_ * size_, arithmetic_);
  if (has_long_rows(device_, view)) {
    if (rows != scratch_rows_) {
      device_.finish();
      scratch_ = RowScratch();
      scratch_ = row_scratch(device_, size_, rows, arithmetic_);
      scratch_rows_ = rows;
    }
    syrk_rows(device_, size_, rows, 1.0, {&T, 0, view.inner, view.inner, size_ * view.inner, true},
              0.0, C, Written::lower, arithmetic_, scratch_);
  } else {
    add_packed(T, view, C);
  }
  ++waiting_;
}

void ModeGram::add_packed(const Buffer& T, const ModeView& view, const Result& C) {
  constexpr std::size_t rows_of_item = 512;
  const std::size_t rows = view.outer * view.inner;
  const std::size_t most = rows_at_once(device_, size_, rows, arithmetic_);
  Buffer packed(device_, packed_elements(device_, most, size_, arithmetic_) * size_of(arithmetic_),
                "unfolded tensor");
  const cl_kernel kernel = device_.kernel(
      kernel_sources::pack_mode,
      fmt::format("{} -DROWS={}", vector_option(device_, arithmetic_), rows_of_item), "pack_mode");
  for (std::size_t first = 0; first < rows; first += most) {
    const std::size_t count = std::min(most, rows - first);
    set_arguments(kernel, T, ulong(size_), ulong(view.inner), ulong(first), ulong(count), packed);
    launch_items(device_, kernel, ceil_div(size_, panel_width(device_, arithmetic_)),
                 ceil_div(count, rows_of_item));
    syrk_packed(device_, size_, count, 1.0, packed, first == 0 ? 0.0 : 1.0, C, Written::lower,
                arithmetic_);
  }
  device_.finish();
}

void ModeGram::add_waiting() {
  with_real(arithmetic_, [&](auto zero) {
    std::vector<decltype(zero)> part(size_ * size_);
    for (std::size_t p = 0; p < waiting_; ++p) {
      device_.read(product_, std::span(part), p * size_ * size_);
      for (std::size_t i = 0; i < size_; ++i) {
        for (std::size_t j = 0; j <= i; ++j) {
          const double value = static_cast<double>(part[i * size_ + j]);
          matrix_[i * size_ + j] += value;
          if (j < i) matrix_[j * size_ + i] += value;
        }
      }
    }
  });
  waiting_ = 0;
}

const std::vector<double>& ModeGram::matrix() {
  add_waiting();
  return matrix_;
}

std::size_t ModeGram::bytes(const Device& device, std::size_t size, std::size_t rows,
                            Arithmetic arithmetic) {
  const std::size_t most = rows_at_once(device, size, rows, arithmetic);
  const std::size_t packed = packed_elements(device, most, size, arithmetic) * size_of(arithmetic) +
                             syrk_bytes(device, size, most, arithmetic);
  const std::size_t in_rows =
      size <= most_long_rows ? syrk_rows_bytes(size, rows, arithmetic) : std::size_t{0};
  return std::max(packed, in_rows) + (waiting_parts(size) + 1) * size * size * size_of(arithmetic) +
         size * size * sizeof(double);
}

}  // namespace weft::ops
