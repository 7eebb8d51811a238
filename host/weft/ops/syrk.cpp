#include "weft/ops/syrk.hpp"

#include <fmt/core.h>

#include <algorithm>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t macro_rows = 96;
constexpr std::size_t macro_panels = 8;
constexpr std::size_t block_panels = 10;

// How the sum over K is cut: a function of the shape alone, so that the bits do not depend on the
// device's units or memory.
struct Slices {
  std::size_t count = 1;
  std::size_t most = 1;   // of any shorter K too
  std::size_t depth = 0;  // whole blocks
};

std::size_t block_depth(const Device& device, Arithmetic arithmetic) {
  return block_panels * panel_width(device, arithmetic);
}

Slices cut(const Device& device, std::size_t m, std::size_t K, Arithmetic arithmetic) {
  const std::size_t block = block_depth(device, arithmetic);
  const std::size_t blocks = ceil_div(K, block);
  // Enough work-items for several units, of at least four blocks each; none longer than 256 blocks
  // as long as the partial sums are small beside X.
  const std::size_t row_tiles = ceil_div(m, macro_rows);
  const std::size_t column_tiles = ceil_div(m, macro_panels * panel_width(device, arithmetic));
  const std::size_t tiles = std::max<std::size_t>(1, row_tiles * (column_tiles + 1) / 2);
  const std::size_t for_units = std::min(ceil_div(32, tiles), std::max<std::size_t>(1, blocks / 4));
  const std::size_t for_accuracy =
      std::min(ceil_div(blocks, 256), std::max<std::size_t>(1, K / (8 * m)));
  Slices slices;
  slices.most = std::max(for_units, for_accuracy);
  slices.depth = ceil_div(blocks, slices.most) * block;
  slices.count = ceil_div(K, slices.depth);
  return slices;
}

cl_kernel kernel_of(Device& device, const char* name, Written triangle, Arithmetic arithmetic) {
  const std::size_t width = panel_width(device, arithmetic);
  return device.kernel(
      kernel_sources::syrk,
      fmt::format("{} -DMC={} -DTC={} -DKC={} -DTRIANGLE={}", vector_option(device, arithmetic),
                  macro_rows, macro_panels * width, block_panels * width,
                  1 + static_cast<int>(triangle)),
      name);
}
}  // namespace

void add_slices(Device& device, std::size_t m, std::size_t slices, const Buffer& partial,
                std::size_t row, double alpha, double beta, const Result& C, Written written,
                Arithmetic arithmetic) {
  const cl_kernel kernel = kernel_of(device, "add_slices", written, arithmetic);
  with_real(arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    set_arguments(kernel, ulong(m), ulong(slices), ulong(row), ulong(m * row),
                  static_cast<Real>(alpha), partial, static_cast<Real>(beta), *C.buffer,
                  ulong(C.offset), ulong(C.row));
  });
  launch_items(device, kernel, m);
}

std::size_t syrk_bytes(const Device& device, std::size_t m, std::size_t K, Arithmetic arithmetic) {
  if (m == 0 || K == 0) return 0;
  const std::size_t slices = cut(device, m, K, arithmetic).most;
  if (slices == 1) return 0;
  return slices * m * round_up(m, panel_width(device, arithmetic)) * size_of(arithmetic);
}

std::size_t syrk_terms(const Device& device, std::size_t m, std::size_t K, Arithmetic arithmetic) {
  if (m == 0 || K == 0) return 3;
  const Slices slices = cut(device, m, K, arithmetic);
  const std::size_t block = block_depth(device, arithmetic);
  const std::size_t blocks = ceil_div(std::min(K, slices.depth), block);
  // products and their sums in a block, the sums of blocks, of slices, alpha, beta and their sum
  return std::min(K, block) + 2 * blocks + slices.count + 3;
}

void syrk_packed(Device& device, std::size_t m, std::size_t K, double alpha, const Buffer& packed,
                 double beta, Buffer& C, std::size_t leading, Arithmetic arithmetic) {
  syrk_packed(device, m, K, alpha, packed, beta, to_row_major(device, C, leading, 0, arithmetic),
              Written::blocks, arithmetic);
}

void syrk_packed(Device& device, std::size_t m, std::size_t K, double alpha, const Buffer& packed,
                 double beta, const Result& C, Written written, Arithmetic arithmetic) {
  require_arithmetic(device, arithmetic);
  if (m == 0) return;
  const std::size_t width = panel_width(device, arithmetic);
  const Slices slices = cut(device, m, K, arithmetic);
  const std::size_t column_tiles = ceil_div(m, macro_panels * width);
  const std::size_t row_tiles = ceil_div(m, macro_rows);
  with_real(arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    if (slices.count == 1) {
      const cl_kernel kernel = kernel_of(device, "syrk_packed", written, arithmetic);
      set_arguments(kernel, ulong(m), ulong(K), ulong(slices.depth), static_cast<Real>(alpha),
                    packed, static_cast<Real>(beta), *C.buffer, ulong(C.offset), ulong(C.row),
                    ulong(0));
      launch_items(device, kernel, column_tiles, row_tiles);
      return;
    }
    const std::size_t row = round_up(m, width);
    Buffer partial(device, slices.count * m * row * size_of(arithmetic),
                   "partial sums of a product");
    const cl_kernel kernel = kernel_of(device, "syrk_packed", Written::blocks, arithmetic);
    set_arguments(kernel, ulong(m), ulong(K), ulong(slices.depth), Real{1}, packed, Real{0},
                  partial, ulong(0), ulong(row), ulong(m * row));
    launch_items(device, kernel, column_tiles, row_tiles * slices.count);
    add_slices(device, m, slices.count, partial, row, alpha, beta, C, written, arithmetic);
    // The driver keeps a released buffer until its kernels have run: no more than one at a time.
    device.finish();
  });
}

}  // namespace weft::ops
