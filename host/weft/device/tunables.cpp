#include "weft/device/tunables.hpp"

namespace weft {
namespace {

constexpr const TunableKernel* all_kernels[] = {
    &tunables::batch_omp,  &tunables::convert_tile, &tunables::decode_lpca,
    &tunables::decode_pca, &tunables::error_sums,   &tunables::gemm,
    &tunables::gemm_tiled, &tunables::scan_tile,    &tunables::transcode_tile,
};

}  // namespace

std::size_t find_macro(const TunableKernel& kernel, std::string_view macro) {
  std::size_t index = 0;
  while (index < kernel.macros.size() && kernel.macros[index].macro != macro) ++index;
  return index;
}

std::span<const TunableKernel* const> tunable_kernels() {
  return all_kernels;
}

const TunableKernel* find_tunable(std::string_view name) {
  for (const TunableKernel* kernel : all_kernels) {
    if (kernel->name == name) return kernel;
  }
  return nullptr;
}

}  // namespace weft
