#include "weft/ops/gemm.hpp"

#include <fmt/core.h>

#include <string>

#include "weft/ops/launch.hpp"

namespace weft {

namespace {
constexpr Tunable gemm_macros[] = {
    {"MC", 96, {24, 48, 96, 192, 384}, "rows of a macro-tile"},
    {"KC", 384, {96, 144, 192, 240, 288, 336, 384, 480}, "depth of a block"},
    {"TILE_PANELS", 8, {4, 8, 12, 16, 20, 24, 32, 40}, "most panels of a macro-tile"},
    {"PACK_ROWS", 64, {16, 32, 64, 128, 256}, "rows that one work-item packs"},
};
}  // namespace
constinit const TunableKernel tunables::gemm{"gemm", gemm_macros};

}  // namespace weft

namespace weft::ops {
namespace {

// Columns of a macro-tile: whole panels, so many that a panel's block of B is reused from the
// caches, and so few that every compute unit has several tiles.
std::size_t macro_columns(const Device& device, std::size_t M, std::size_t N,
                          Arithmetic arithmetic) {
  const std::size_t macro_rows = device.parameter(tunables::gemm, "MC");
  const std::size_t width = panel_width(device, arithmetic);
  const std::size_t most = device.parameter(tunables::gemm, "TILE_PANELS") * width;
  const std::size_t row_tiles = ceil_div(M, macro_rows);
  const std::size_t wanted_tiles = 8;  // fixed: no result may depend on the number of units
  const std::size_t columns = round_up(ceil_div(N * row_tiles, wanted_tiles), width);
  return std::clamp(columns, width, most);
}

// A packed part stays in the caches, and in memory that is handed out again without page faults.
constexpr std::size_t most_packed_bytes = std::size_t{8} << 20;

// The columns and matrices of a batch that are packed at a time: whole panels, at least one.
struct Parts {
  std::size_t columns = 0;
  std::size_t batch = 0;
};
Parts cut(const Device& device, std::size_t N, std::size_t K, Arithmetic arithmetic,
          std::size_t batch) {
  const std::size_t width = panel_width(device, arithmetic);
  const std::size_t panel_bytes = width * K * size_of(arithmetic);
  const std::size_t most = std::max<std::size_t>(1, most_packed_bytes / panel_bytes);
  // parts of the same size
  const std::size_t panels = ceil_div(N, width);
  const std::size_t part_panels = ceil_div(panels, ceil_div(panels, most));
  return {part_panels * width,
          part_panels < panels ? 1 : std::clamp<std::size_t>(most / panels, 1, batch)};
}

std::string gemm_options(const Device& device, const Operand& A) {
  return fmt::format("{} {} -DA_TRANSPOSED={} -DA_PANELLED={}", vector_option(device, A.arithmetic),
                     device.tuned_options(tunables::gemm),
                     A.layout == Operand::Layout::transposed ? 1 : 0,
                     A.layout == Operand::Layout::panelled ? 1 : 0);
}
}  // namespace

Operand row_major(const Device& device, const Buffer& buffer, std::size_t leading,
                  std::size_t offset, Arithmetic arithmetic) {
  return {&buffer,
          offset,
          leading,
          1,
          panel_width(device, arithmetic),
          arithmetic,
          Operand::Layout::row_major};
}

Operand transposed(const Device& device, const Buffer& buffer, std::size_t leading,
                   std::size_t offset, Arithmetic arithmetic) {
  return {&buffer,
          offset,
          1,
          leading,
          panel_width(device, arithmetic) * leading,
          arithmetic,
          Operand::Layout::transposed};
}

Operand panelled(const Device& device, const Buffer& buffer, std::size_t rows,
                 Arithmetic arithmetic) {
  const std::size_t width = panel_width(device, arithmetic);
  return {&buffer, 0, width, 1, rows * width, arithmetic, Operand::Layout::panelled};
}

std::size_t packed_elements(const Device& device, std::size_t K, std::size_t N,
                            Arithmetic arithmetic) {
  return K * round_up(N, panel_width(device, arithmetic));
}

std::size_t gemm_terms(const Device& device, std::size_t K) {
  const std::size_t depth = device.parameter(tunables::gemm, "KC");
  // products and their sums in a block, the sums of blocks, alpha, beta and their sum
  return std::min(K, depth) + 2 * ceil_div(K, depth) + 3;
}

void pack_panels(Device& device, const Operand& B, std::size_t K, std::size_t N, Buffer& packed,
                 std::size_t batch) {
  require_arithmetic(device, B.arithmetic);
  // Rows of a transposed matrix are neighbours in memory: long runs of them.
  const std::size_t pack_rows = device.parameter(tunables::gemm, "PACK_ROWS") *
                                (B.layout == Operand::Layout::transposed ? 16 : 1);
  const cl_kernel kernel =
      device.kernel(kernel_sources::gemm, gemm_options(device, {nullptr, 0, 0, 0, 0, B.arithmetic}),
                    "pack_panels");
  set_arguments(kernel, *B.buffer, ulong(B.offset), ulong(B.row), ulong(B.column), ulong(B.batch),
                ulong(K), ulong(N), ulong(pack_rows), packed);
  launch_items(device, kernel, ceil_div(N, panel_width(device, B.arithmetic)),
               ceil_div(K, pack_rows), batch);
}

Result to_row_major(const Device& device, Buffer& buffer, std::size_t leading, std::size_t offset,
                    Arithmetic arithmetic) {
  return {&buffer, offset, leading, panel_width(device, arithmetic)};
}

Result to_panels(const Device& device, Buffer& buffer, std::size_t rows, Arithmetic arithmetic) {
  const std::size_t width = panel_width(device, arithmetic);
  return {&buffer, 0, width, rows * width};
}

void gemm_packed(Device& device, std::size_t M, std::size_t N, std::size_t K, double alpha,
                 const Operand& A, const Packed& B, double beta, const Result& C,
                 std::size_t batch) {
  require_arithmetic(device, A.arithmetic);
  const std::size_t columns = macro_columns(device, M, N, A.arithmetic);
  const std::size_t macro_rows = device.parameter(tunables::gemm, "MC");
  const cl_kernel kernel = device.kernel(kernel_sources::gemm, gemm_options(device, A), "gemm");
  with_real(A.arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    set_arguments(kernel, ulong(M), ulong(N), ulong(K), ulong(columns), static_cast<Real>(alpha),
                  *A.buffer, ulong(A.offset), ulong(A.row), ulong(A.column), ulong(A.panel),
                  ulong(A.batch), B.buffer, ulong(B.offset),
                  ulong(B.shared ? 0 : packed_elements(device, K, N, A.arithmetic)),
                  static_cast<Real>(beta), *C.buffer, ulong(C.offset), ulong(C.row), ulong(C.panel),
                  ulong(C.batch));
  });
  launch_items(device, kernel, ceil_div(N, columns), ceil_div(M, macro_rows), batch);
}

std::size_t gemm_bytes(const Device& device, std::size_t N, std::size_t K, Arithmetic arithmetic,
                       std::size_t batch) {
  const Parts parts = cut(device, N, K, arithmetic, batch);
  return packed_elements(device, K, parts.columns, arithmetic) * parts.batch * size_of(arithmetic);
}

void gemm(Device& device, std::size_t M, std::size_t N, std::size_t K, double alpha,
          const Operand& A, const Operand& B, double beta, const Result& C, std::size_t batch) {
  const std::size_t width = panel_width(device, B.arithmetic);
  const Parts parts = cut(device, N, K, B.arithmetic, batch);
  Buffer packed(device, gemm_bytes(device, N, K, B.arithmetic, batch), "packed matrix");
  for (std::size_t first = 0; first < batch; first += parts.batch) {
    const std::size_t count = std::min(parts.batch, batch - first);
    Operand a = A;
    a.offset += first * A.batch;
    for (std::size_t j = 0; j < N; j += parts.columns) {
      const std::size_t columns = std::min(parts.columns, N - j);
      Operand b = B;
      b.offset += first * B.batch + j * B.column;
      Result c = C;
      c.offset += first * C.batch + j / width * C.panel;
      pack_panels(device, b, K, columns, packed, count);
      gemm_packed(device, M, columns, K, alpha, a, packed, beta, c, count);
    }
  }
}

void scale_matrix(Device& device, std::size_t M, std::size_t N, double beta, const Result& C,
                  Arithmetic arithmetic, std::size_t batch, unsigned triangle) {
  require_arithmetic(device, arithmetic);
  const cl_kernel kernel = device.kernel(
      kernel_sources::gemm, gemm_options(device, {nullptr, 0, 0, 0, 0, arithmetic}), "scale");
  with_real(arithmetic, [&](auto zero) {
    set_arguments(kernel, ulong(N), cl_uint{triangle}, static_cast<decltype(zero)>(beta), *C.buffer,
                  ulong(C.offset), ulong(C.row), ulong(C.batch));
  });
  launch_items(device, kernel, M, batch);
}

}  // namespace weft::ops
