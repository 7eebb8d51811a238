#include "weft/ops/gram.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
// Columns of a block: whole panels. It bounds the partial sums.
constexpr std::size_t block_columns = 240;

// A function of n alone, so that sums do not depend on the device's load or memory.
std::size_t chunk_rows(std::size_t n) {
  return std::max<std::size_t>(512, ceil_div(n, 64));
}

template <typename T>
std::vector<double> add_chunks(Device& device, const Buffer& partial, std::size_t chunks,
                               std::size_t elements) {
  std::vector<T> pairs(chunks * elements * 2);
  device.read(partial, std::span<T>(pairs));
  std::vector<double> sums(elements, 0.0);
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    for (std::size_t e = 0; e < elements; ++e) {
      const std::size_t at = (chunk * elements + e) * 2;
      sums[e] += static_cast<double>(pairs[at]) + static_cast<double>(pairs[at + 1]);
    }
  }
  return sums;
}

std::string gram_options(const Device& device, Arithmetic arithmetic, bool fp64) {
  return fmt::format("{} -DDOUBLE={}", vector_option(device, arithmetic), fp64 ? 1 : 0);
}

// Columns of Z that a work-item takes.
std::size_t item_columns(Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? 8 : 4;
}

// Powers of two that bring the largest value of each column into [0.5, 1), as far as float allows.
struct ColumnScales {
  Buffer buffer;
  std::vector<int> exponents;
};

ColumnScales column_scales(Device& device, std::size_t n, const Columns& X) {
  const std::size_t rows = chunk_rows(n);
  const std::size_t chunks = std::max<std::size_t>(1, ceil_div(n, rows));
  Buffer maxima(device, chunks * X.count * sizeof(float), "largest values of columns");
  const cl_kernel kernel = device.kernel(
      kernel_sources::gram, gram_options(device, Arithmetic::f32, false), "column_maxima");
  set_arguments(kernel, ulong(n), ulong(rows), ulong(X.count), *X.buffer, ulong(X.offset),
                ulong(X.panel), ulong(X.row), maxima);
  launch_items(device, kernel, chunks, ceil_div(X.count, 8));
  std::vector<float> host(chunks * X.count);
  device.read(maxima, std::span<float>(host));

  ColumnScales scales;
  // The kernel reads whole vectors.
  std::vector<float> values(round_up(X.count, panel_width(device)), 1.0f);
  for (std::size_t j = 0; j < X.count; ++j) {
    float largest = 0;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      largest = std::max(largest, host[chunk * X.count + j]);
    }
    int exponent = 0;
    if (largest > 0 && std::isfinite(largest)) std::frexp(largest, &exponent);
    scales.exponents.push_back(std::clamp(-exponent, -126, 127));
    values[j] = std::ldexp(1.0f, scales.exponents.back());
  }
  scales.buffer = Buffer(device, values.size() * sizeof(float), "scales of columns");
  device.write(scales.buffer, std::span<const float>(values));
  return scales;
}
// G of at most block_columns columns on either side.
std::vector<double> gram_block(Device& device, std::size_t n, const Columns& X, const Columns& Z,
                               GramSums sums) {
  const std::size_t rows = chunk_rows(n);
  const std::size_t chunks = std::max<std::size_t>(1, ceil_div(n, rows));
  const std::size_t elements = X.count * Z.count;
  const Arithmetic arithmetic = X.arithmetic;
  const bool fp64 =
      device.limits().has_fp64 && (sums == GramSums::best || arithmetic == Arithmetic::f64);
  const std::size_t pair_bytes = 2 * (fp64 ? sizeof(double) : sizeof(float));
  Buffer partial(device, chunks * elements * pair_bytes, "partial inner products");
  const cl_kernel kernel =
      device.kernel(kernel_sources::gram, gram_options(device, arithmetic, fp64), "gram");
  if (fp64) {
    set_arguments(kernel, ulong(n), ulong(rows), ulong(X.count), ulong(Z.count), *X.buffer,
                  ulong(X.offset), ulong(X.panel), ulong(X.row), *Z.buffer, ulong(Z.offset),
                  ulong(Z.panel), ulong(Z.row), partial);
    launch_items(device, kernel, chunks, ceil_div(Z.count, item_columns(arithmetic)));
    return add_chunks<double>(device, partial, chunks, elements);
  }
  const ColumnScales x_scales = column_scales(device, n, X);
  const ColumnScales z_scales = column_scales(device, n, Z);
  set_arguments(kernel, ulong(n), ulong(rows), ulong(X.count), ulong(Z.count), *X.buffer,
                ulong(X.offset), ulong(X.panel), ulong(X.row), *Z.buffer, ulong(Z.offset),
                ulong(Z.panel), ulong(Z.row), partial, x_scales.buffer, z_scales.buffer);
  launch_items(device, kernel, chunks, ceil_div(Z.count, 8));
  std::vector<double> G = add_chunks<float>(device, partial, chunks, elements);
  for (std::size_t i = 0; i < X.count; ++i) {
    for (std::size_t j = 0; j < Z.count; ++j) {
      double& value = G[i * Z.count + j];
      value = std::ldexp(value, -x_scales.exponents[i] - z_scales.exponents[j]);
    }
  }
  return G;
}
}  // namespace

Columns packed_columns(const Device& device, const Buffer& buffer, std::size_t n, std::size_t count,
                       Arithmetic arithmetic) {
  const std::size_t width = panel_width(device, arithmetic);
  return {&buffer, count, n * width, width, arithmetic, 0};
}

Columns row_major_columns(const Device& device, const Buffer& buffer, std::size_t leading,
                          std::size_t count, Arithmetic arithmetic) {
  return {&buffer, count, panel_width(device, arithmetic), leading, arithmetic, 0};
}

std::size_t gram_bytes(std::size_t n, std::size_t count_x, std::size_t count_z) {
  return std::max<std::size_t>(1, ceil_div(n, chunk_rows(n))) * std::min(count_x, block_columns) *
         std::min(count_z, block_columns) * 2 * sizeof(double);
}

std::vector<double> gram(Device& device, std::size_t n, const Columns& X, const Columns& Z,
                         GramSums sums) {
  require_arithmetic(device, X.arithmetic);
  std::vector<double> G(X.count * Z.count);
  const std::size_t width = panel_width(device, X.arithmetic);
  const auto block = [&](const Columns& columns, std::size_t first) {
    Columns part = columns;
    part.offset += first / width * columns.panel;
    part.count = std::min(block_columns, columns.count - first);
    return part;
  };
  for (std::size_t i = 0; i < X.count; i += block_columns) {
    for (std::size_t j = 0; j < Z.count; j += block_columns) {
      const Columns x = block(X, i);
      const Columns z = block(Z, j);
      const std::vector<double> part = gram_block(device, n, x, z, sums);
      for (std::size_t a = 0; a < x.count; ++a) {
        std::copy_n(part.data() + a * z.count, z.count, G.data() + (i + a) * Z.count + j);
      }
    }
  }
  return G;
}

}  // namespace weft::ops
