#include "weft/ops/gemm_tiled.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <string>

#include "weft/ops/launch.hpp"

namespace weft {
namespace {
constexpr Tunable tiled_macros[] = {
    {"MWG", 64, {8, 16, 32, 64, 128}, "rows of a tile"},
    {"NWG", 64, {8, 16, 32, 64, 128}, "columns of a tile"},
    {"KWG", 16, {8, 16, 32}, "depth of a tile"},
    {"MDIMC", 16, {4, 8, 16, 32}, "work-items across rows"},
    {"NDIMC", 16, {4, 8, 16, 32}, "work-items across columns"},
    {"VWM", 2, {1, 2, 4, 8}, "rows that lie together"},
    {"VWN", 2, {1, 2, 4, 8}, "lanes of a vector across columns"},
};

ops::TileMacros tile_of(std::span<const std::size_t> values) {
  return {values[0], values[1], values[2], values[3], values[4], values[5], values[6]};
}

std::string tiled_conflict(std::span<const std::size_t> values, const DeviceLimits& limits) {
  const ops::TileMacros tile = tile_of(values);
  if (tile.MWG % (tile.MDIMC * tile.VWM) != 0) return "MWG is not a multiple of MDIMC VWM";
  if (tile.NWG % (tile.NDIMC * tile.VWN) != 0) return "NWG is not a multiple of NDIMC VWN";
  if (tile.MDIMC * tile.NDIMC > limits.max_work_group) {
    return fmt::format("work-groups of {} exceed {}", tile.MDIMC * tile.NDIMC,
                       limits.max_work_group);
  }
  const std::size_t bytes = ops::local_bytes(tile, Arithmetic::f32);
  if (bytes > limits.local_memory) {
    return fmt::format("tiles of {} bytes exceed a local memory of {}", bytes, limits.local_memory);
  }
  return {};
}
}  // namespace
constinit const TunableKernel tunables::gemm_tiled{"gemm_tiled", tiled_macros, tiled_conflict};

}  // namespace weft

namespace weft::ops {
namespace {
constexpr std::size_t block_depth = 512;
}  // namespace

std::size_t local_bytes(const TileMacros& tile, Arithmetic arithmetic) {
  return tile.KWG * (tile.MWG + 1 + tile.NWG) * size_of(arithmetic);
}

TileMacros fitted(TileMacros tile, std::size_t max_work_group, std::size_t local_memory,
                  Arithmetic arithmetic) {
  // Fewer work-items with as much work each.
  while (tile.MDIMC * tile.NDIMC > std::max<std::size_t>(1, max_work_group)) {
    if (tile.MDIMC >= tile.NDIMC) {
      tile.MDIMC /= 2;
      tile.MWG /= 2;
    } else {
      tile.NDIMC /= 2;
      tile.NWG /= 2;
    }
  }
  // Shallower tiles, then smaller ones.
  const auto too_large = [&] { return local_bytes(tile, arithmetic) > local_memory; };
  while (too_large() && tile.KWG > std::max(tile.VWM, tile.VWN)) tile.KWG /= 2;
  while (too_large() && (tile.MWG > tile.MDIMC * tile.VWM || tile.NWG > tile.NDIMC * tile.VWN)) {
    if (tile.MWG > tile.MDIMC * tile.VWM) tile.MWG /= 2;
    if (tile.NWG > tile.NDIMC * tile.VWN) tile.NWG /= 2;
  }
  return tile;
}

std::size_t gemm_tiled_terms(std::size_t K) {
  // products and their sums in a block, the sums of blocks, alpha, beta and their sum
  return std::min(K, block_depth) + 2 * ceil_div(K, block_depth) + 3;
}

void gemm_tiled(Device& device, const TiledShape& shape, double alpha, const ConstMatrix& A,
                const ConstMatrix& B, double beta, const Matrix& C, const ProductOptions& options) {
  require_arithmetic(device, options.arithmetic);
  // Asking for one value says that the kernel's entry is in use.
  (void)device.parameter(tunables::gemm_tiled, "MWG");
  const TileMacros tile =
      fitted(tile_of(device.tuning().values(tunables::gemm_tiled)), device.limits().max_work_group,
             device.limits().local_memory, options.arithmetic);
  const cl_kernel kernel = device.kernel(
      kernel_sources::gemm_tiled,
      fmt::format("-DARITHMETIC={} -DA_TRANSPOSED={} -DB_TRANSPOSED={} -DTRIANGLE={} -DMWG={} "
                  "-DNWG={} -DKWG={} -DMDIMC={} -DNDIMC={} -DVWM={} -DVWN={} -DKC={}",
                  8 * size_of(options.arithmetic), shape.a_transposed ? 1 : 0,
                  shape.b_transposed ? 1 : 0, shape.triangle, tile.MWG, tile.NWG, tile.KWG,
                  tile.MDIMC, tile.NDIMC, tile.VWM, tile.VWN, block_depth),
      "gemm_tiled");
  with_real(options.arithmetic, [&](auto zero) {
    using Real = decltype(zero);
    set_arguments(kernel, ulong(shape.M), ulong(shape.N), ulong(shape.K), static_cast<Real>(alpha),
                  A.buffer, ulong(A.offset), ulong(A.leading), ulong(A.stride), B.buffer,
                  ulong(B.offset), ulong(B.leading), ulong(B.stride), static_cast<Real>(beta),
                  C.buffer, ulong(C.offset), ulong(C.leading), ulong(C.stride));
  });
  const std::array<std::size_t, 3> global{ceil_div(shape.N, tile.NWG) * tile.NDIMC,
                                          ceil_div(shape.M, tile.MWG) * tile.MDIMC, options.batch};
  const std::array<std::size_t, 3> local{tile.NDIMC, tile.MDIMC, 1};
  device.launch(kernel, global, local);
}

}  // namespace weft::ops
