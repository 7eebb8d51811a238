#include "weft/ops/tsqr.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "weft/error.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Triangles that are merged one after the other before the result goes up a level.
constexpr std::size_t arity = 16;
constexpr std::size_t upper_levels = 2;

template <typename Real>
std::vector<double> read_upper(Device& device, const Buffer& triangles, std::size_t elements,
                               std::size_t m, std::size_t width) {
  std::vector<Real> triangle(elements);
  device.read(triangles, std::span<Real>(triangle));
  std::vector<double> R(m * m, 0.0);
  for (std::size_t j = 0; j < m; ++j) {
    const std::size_t q = j / width;
    for (std::size_t i = 0; i <= j; ++i) {
      const std::size_t panel = width * width * (q * (q + 1) / 2);
      const double value = static_cast<double>(triangle[panel + i * width + j % width]);
      if (!std::isfinite(value)) {
        fail_runtime("column {} of a matrix holds NaN or an infinity, or is too large to factor",
                     j);
      }
      R[i * m + j] = value;
    }
  }
  return R;
}

}  // namespace

Tsqr::Shape Tsqr::shape_of(const Device& device, std::size_t m, Arithmetic arithmetic,
                           Workspace workspace) {
  if (m == 0) fail_input("TSQR: a matrix without columns has no triangular factor");
  Shape shape;
  shape.width = panel_width(device, arithmetic);
  shape.panels = ceil_div(m, shape.width);
  const bool lean = workspace == Workspace::lean;
  // Merging costs m / (48 b) of the reduction.
  shape.rows = std::clamp<std::size_t>(round_up(m / 2, 8), lean ? 256 : 1024, 2048);
  shape.block = shape.panels * shape.width * shape.rows;
  // Few columns: work for many units comes from many chains. Many columns: it comes from their
  // panels, and the chains' blocks share the last cache.
  constexpr std::size_t cached_bytes = std::size_t{16} << 20;
  const std::size_t cached = cached_bytes / (shape.block * size_of(arithmetic));
  shape.chains = lean ? 2 : cached >= 8 ? 8 : cached >= 4 ? 4 : 2;
  shape.triangle = shape.width * shape.width * (shape.panels * (shape.panels + 1) / 2);
  return shape;
}

std::size_t Tsqr::bytes(const Device& device, std::size_t m, Arithmetic arithmetic,
                        Workspace workspace) {
  const Shape shape = shape_of(device, m, arithmetic, workspace);
  const std::size_t elements = shape.chains * (shape.block + shape.width * shape.width) +
                               (shape.chains + upper_levels + 1) * shape.triangle;
  return elements * size_of(arithmetic) + m * m * sizeof(double);
}

Tsqr::Tsqr(Device& device, std::size_t m, Arithmetic arithmetic, Workspace workspace)
    : device_(device), m_(m), arithmetic_(arithmetic) {
  require_arithmetic(device, arithmetic);
  shape_ = shape_of(device, m, arithmetic, workspace);
  const std::size_t size = size_of(arithmetic);
  blocks_ = Buffer(device, shape_.chains * shape_.block * size, "blocks of rows");
  triangles_ =
      Buffer(device, (shape_.chains + upper_levels) * shape_.triangle * size, "triangular factors");
  factors_ =
      Buffer(device, shape_.chains * shape_.width * shape_.width * size, "reflector factors");
  clear(0, shape_.chains + upper_levels);
}

void Tsqr::add(const Buffer& packed, std::size_t K) {
  const cl_kernel kernel =
      device_.kernel(kernel_sources::tsqr, vector_option(device_, arithmetic_), "append_rows");
  const std::size_t batch = shape_.chains * shape_.rows;
  for (std::size_t first = 0; first < K;) {
    const std::size_t count = std::min(K - first, batch - filled_);
    set_arguments(kernel, ulong(m_), packed, ulong(K), ulong(first), ulong(count), ulong(filled_),
                  blocks_, ulong(shape_.block), ulong(shape_.rows));
    launch_items(device_, kernel, shape_.panels, shape_.chains);
    first += count;
    filled_ += count;
    if (filled_ == batch) reduce_blocks();
  }
}

void Tsqr::reduce(const Operands& o, std::size_t chains, bool triangular, std::size_t rows) {
  const std::string options = vector_option(device_, arithmetic_);
  const cl_kernel factor = device_.kernel(kernel_sources::tsqr, options, "factor_panel");
  const cl_kernel apply = device_.kernel(kernel_sources::tsqr, options, "apply_panel");
  for (std::size_t panel = 0; panel < shape_.panels; ++panel) {
    const auto set = [&](cl_kernel kernel, const auto&... more) {
      set_arguments(kernel, ulong(panel), cl_uint{triangular}, ulong(rows), ulong(shape_.rows),
                    *o.R, ulong(o.r_offset), ulong(o.r_step), *o.B, ulong(o.b_offset),
                    ulong(o.b_step), factors_, more...);
    };
    set(factor, ulong(m_));
    set(apply);
    launch_items(device_, factor, chains);
    launch_items(device_, apply, shape_.panels - panel - 1, chains);
  }
}

void Tsqr::reduce_blocks() {
  if (filled_ == 0) return;
  const std::size_t chains = ceil_div(filled_, shape_.rows);
  reduce({&triangles_, 0, shape_.triangle, &blocks_, 0, shape_.block}, chains, false, filled_);
  used_chains_ = std::max(used_chains_, chains);
  filled_ = 0;
  if (++batches_ < arity) return;
  // up to the second level, and to the third
  merge_chains();
  merge(second_level(), 0, 1, 1);
  batches_ = 0;
  used_chains_ = 0;
  if (++in_second_level_ < arity) return;
  merge(third_level(), second_level(), 1, 1);
  in_second_level_ = 0;
  third_level_used_ = true;
}

void Tsqr::merge(std::size_t onto, std::size_t from, std::size_t step, std::size_t count) {
  const std::size_t size = shape_.triangle;
  reduce({&triangles_, onto * size, step * size, &triangles_, from * size, step * size}, count,
         true, 0);
  for (std::size_t i = 0; i < count; ++i) clear(from + i * step, 1);
}

void Tsqr::merge_chains() {
  for (std::size_t apart = 1; apart < used_chains_; apart *= 2) {
    merge(0, apart, 2 * apart, ceil_div(used_chains_ - apart, 2 * apart));
  }
}

void Tsqr::clear(std::size_t first, std::size_t count) {
  const cl_kernel kernel =
      device_.kernel(kernel_sources::tsqr, vector_option(device_, arithmetic_), "clear_triangle");
  set_arguments(kernel, triangles_, ulong(first * shape_.triangle));
  launch_items(device_, kernel, count * shape_.triangle / (shape_.width * shape_.width));
}

std::vector<double> Tsqr::R() {
  reduce_blocks();
  merge_chains();
  if (in_second_level_ > 0) merge(0, second_level(), 1, 1);
  if (third_level_used_) merge(0, third_level(), 1, 1);
  in_second_level_ = 0;
  third_level_used_ = false;
  used_chains_ = 1;
  return arithmetic_ == Arithmetic::f32
             ? read_upper<float>(device_, triangles_, shape_.triangle, m_, shape_.width)
             : read_upper<double>(device_, triangles_, shape_.triangle, m_, shape_.width);
}

}  // namespace weft::ops
