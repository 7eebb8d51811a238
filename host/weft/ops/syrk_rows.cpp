#include "weft/ops/syrk_rows.hpp"

#include <fmt/core.h>

#include <algorithm>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Functions of the shape alone, so that the bits do not depend on the device's units or memory.
struct Cut {
  std::size_t depth = 0;  // of a block
  std::size_t slice = 0;  // columns, whole blocks
  std::size_t slices = 0;
};

Cut cut(std::size_t m, std::size_t K, Arithmetic arithmetic) {
  // A block's copy leaves half of a second cache of 512 KiB or more to what is read meanwhile.
  constexpr std::size_t cached_bytes = std::size_t{384} << 10;
  constexpr std::size_t whole_vectors = 64;
  Cut result;
  result.depth = std::clamp<std::size_t>(
      cached_bytes / (m * size_of(arithmetic)) / whole_vectors * whole_vectors, 128, 2048);
  const std::size_t blocks = ceil_div(K, result.depth);
  result.slice = ceil_div(blocks, std::min<std::size_t>(blocks, 32)) * result.depth;
  result.slices = ceil_div(K, result.slice);
  return result;
}

std::size_t row_of(std::size_t m) {
  return round_up(m, 4);
}

}  // namespace

RowScratch row_scratch(Device& device, std::size_t m, std::size_t K, Arithmetic arithmetic) {
  const Cut parts = cut(m, K, arithmetic);
  const std::size_t size = size_of(arithmetic);
  return {Buffer(device, parts.slices * m * parts.depth * size, "blocks of long rows"),
          Buffer(device, parts.slices * m * row_of(m) * size, "partial sums of a product")};
}

void syrk_rows(Device& device, std::size_t m, std::size_t K, double alpha, const LongRows& X,
               double beta, const Result& C, Written written, Arithmetic arithmetic,
               RowScratch& scratch) {
  require_arithmetic(device, arithmetic);
  if (m == 0) return;
  const Cut parts = cut(m, K, arithmetic);
  const std::size_t x_bits = X.floats ? 32 : 8 * size_of(arithmetic);
  const cl_kernel kernel = device.kernel(
      kernel_sources::syrk_rows,
      fmt::format("{} -DX_BITS={}", vector_option(device, arithmetic), x_bits), "syrk_rows");
  set_arguments(kernel, ulong(m), ulong(K), ulong(parts.slice), ulong(parts.depth), *X.buffer,
                ulong(X.offset), ulong(X.leading), ulong(X.inner > 0 ? X.inner : K), ulong(X.batch),
                scratch.copy, scratch.partial, ulong(row_of(m)));
  launch_items(device, kernel, parts.slices);
  add_slices(device, m, parts.slices, scratch.partial, row_of(m), alpha, beta, C, written,
             arithmetic);
}

void syrk_rows(Device& device, std::size_t m, std::size_t K, double alpha, const LongRows& X,
               double beta, const Result& C, Written written, Arithmetic arithmetic) {
  if (m == 0) return;
  RowScratch scratch = row_scratch(device, m, K, arithmetic);
  syrk_rows(device, m, K, alpha, X, beta, C, written, arithmetic, scratch);
  // The driver keeps a released buffer until its kernels have run: no more than one at a time.
  device.finish();
}

std::size_t syrk_rows_bytes(std::size_t m, std::size_t K, Arithmetic arithmetic) {
  if (m == 0 || K == 0) return 0;
  const Cut parts = cut(m, K, arithmetic);
  return parts.slices * m * (parts.depth + row_of(m)) * size_of(arithmetic);
}

std::size_t syrk_rows_terms(std::size_t m, std::size_t K, Arithmetic arithmetic) {
  if (m == 0 || K == 0) return 3;
  const Cut parts = cut(m, K, arithmetic);
  // a lane's sum of a block, in the narrowest vectors, and of its lanes; the sums of blocks and of
  // slices; alpha, beta and their sum
  return std::min(K, parts.depth) / 4 + 1 + 4 + parts.slice / parts.depth + parts.slices + 3;
}

}  // namespace weft::ops
