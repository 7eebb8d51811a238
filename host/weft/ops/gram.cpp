#include "weft/ops/gram.hpp"

#include <fmt/core.h>

#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
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
}  // namespace

Columns packed_columns(const Device& device, const Buffer& buffer, std::size_t n,
                       std::size_t count) {
  const std::size_t width = panel_width(device);
  return {&buffer, count, n * width, width};
}

Columns row_major_columns(const Device& device, const Buffer& buffer, std::size_t leading,
                          std::size_t count) {
  return {&buffer, count, panel_width(device), leading};
}

std::vector<double> gram(Device& device, std::size_t n, const Columns& X, const Columns& Z) {
  const std::size_t rows = chunk_rows(n);
  const std::size_t chunks = std::max<std::size_t>(1, ceil_div(n, rows));
  const std::size_t elements = X.count * Z.count;
  if (elements == 0) return {};
  const bool fp64 = device.limits().has_fp64;
  const std::size_t pair_bytes = 2 * (fp64 ? sizeof(double) : sizeof(float));
  Buffer partial(device, chunks * elements * pair_bytes, "partial inner products");
  const cl_kernel kernel =
      device.kernel(kernel_sources::gram,
                    fmt::format("{} -DDOUBLE={}", vector_option(device), fp64 ? 1 : 0), "gram");
  set_arguments(kernel, ulong(n), ulong(rows), ulong(X.count), ulong(Z.count), *X.buffer,
                ulong(X.panel), ulong(X.row), *Z.buffer, ulong(Z.panel), ulong(Z.row), partial);
  launch_items(device, kernel, chunks, ceil_div(Z.count, 8));
  return fp64 ? add_chunks<double>(device, partial, chunks, elements)
              : add_chunks<float>(device, partial, chunks, elements);
}

}  // namespace weft::ops
