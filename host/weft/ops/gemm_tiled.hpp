// Launcher of the products for GPUs: kernels/gemm_tiled.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/matrix_product.hpp"

namespace weft::ops {

struct TiledShape {
  std::size_t M = 0;
  std::size_t N = 0;
  std::size_t K = 0;
  bool a_transposed = false;
  bool b_transposed = false;
  unsigned triangle = 0;  // 0: all of C, 1: columns up to the row, 2: columns from the row
};

// C = alpha op(A) op(B) + beta C; nothing is 0. Tiles are made smaller where the tuned ones exceed
// the device's local memory or work-groups.
void gemm_tiled(Device& device, const TiledShape& shape, double alpha, const ConstMatrix& A,
                const ConstMatrix& B, double beta, const Matrix& C, const ProductOptions& options);

// Roundings that a product can go through on its way into C.
std::size_t gemm_tiled_terms(std::size_t K);

// The macros of a tile, in the order of tunables::gemm_tiled.
struct TileMacros {
  std::size_t MWG, NWG, KWG, MDIMC, NDIMC, VWM, VWN;
  bool operator==(const TileMacros&) const = default;
};
// Bytes of local memory that a work-group needs.
std::size_t local_bytes(const TileMacros& tile, Arithmetic arithmetic);
// The nearest smaller tile that a device with such limits can run.
TileMacros fitted(TileMacros tile, std::size_t max_work_group, std::size_t local_memory,
                  Arithmetic arithmetic);

}  // namespace weft::ops
