#include "weft/ops/mode_product.hpp"

#include <fmt/core.h>

#include <algorithm>

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
  ProductOptions options;
  options.batch = view.outer;
  gemm(device, projects ? Transpose::yes : Transpose::no, Transpose::no, other_size, view.inner,
       view.size, 1.0, {U, columns}, {T, view.inner, 0, view.size * view.inner}, 0.0,
       {out, view.inner, 0, other_size * view.inner}, options);
}

std::size_t mode_product_bytes(const Device& device, const ModeView& view, std::size_t other_size) {
  ProductOptions options;
  if (view.inner == 1) return product_bytes(device, other_size, view.size, options);
  options.batch = view.outer;
  return product_bytes(device, view.inner, view.size, options);
}

ModeGram::ModeGram(Device& device, std::size_t size, Arithmetic arithmetic)
    : device_(device), size_(size), arithmetic_(arithmetic), matrix_(size * size, 0.0) {
  require_arithmetic(device, arithmetic);
  product_ = Buffer(device, size * size * size_of(arithmetic), "Gram matrix of a mode");
}

void ModeGram::add(const Buffer& T, const ModeView& view) {
  constexpr std::size_t rows_of_item = 512;
  const std::size_t rows = view.outer * view.inner;
  if (rows == 0) return;
  const std::size_t most = rows_at_once(device_, size_, rows, arithmetic_);
  Buffer packed(device_, packed_elements(device_, most, size_, arithmetic_) * size_of(arithmetic_),
                "unfolded tensor");
  const cl_kernel kernel = device_.kernel(
      kernel_sources::pack_mode,
      fmt::format("{} -DROWS={}", vector_option(device_, arithmetic_), rows_of_item), "pack_mode");
  const Result C = to_row_major(device_, product_, size_, 0, arithmetic_);
  for (std::size_t first = 0; first < rows; first += most) {
    const std::size_t count = std::min(most, rows - first);
    set_arguments(kernel, T, ulong(size_), ulong(view.inner), ulong(first), ulong(count), packed);
    launch_items(device_, kernel, ceil_div(size_, panel_width(device_, arithmetic_)),
                 ceil_div(count, rows_of_item));
    syrk_packed(device_, size_, count, 1.0, packed, first == 0 ? 0.0 : 1.0, C, Written::lower,
                arithmetic_);
  }
  const auto accumulate = [&](auto zero) {
    std::vector<decltype(zero)> part(size_ * size_);
    device_.read(product_, std::span(part));
    for (std::size_t i = 0; i < size_; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        const double value = static_cast<double>(part[i * size_ + j]);
        matrix_[i * size_ + j] += value;
        if (j < i) matrix_[j * size_ + i] += value;
      }
    }
  };
  with_real(arithmetic_, accumulate);
}

std::size_t ModeGram::bytes(const Device& device, std::size_t size, std::size_t rows,
                            Arithmetic arithmetic) {
  const std::size_t most = rows_at_once(device, size, rows, arithmetic);
  return (packed_elements(device, most, size, arithmetic) + 2 * size * size) * size_of(arithmetic) +
         syrk_bytes(device, size, most, arithmetic) + size * size * sizeof(double);
}

}  // namespace weft::ops
