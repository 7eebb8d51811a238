// Images from models.
#include <fmt/core.h>

#include <memory>

#include "bench/benchmark.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"

namespace weft {
namespace {

Benchmark pca(std::size_t rank) {
  const ops::DecodePcaShape shape{0, 64, 16384, 3, rank};
  const std::size_t count = shape.images * shape.texels * shape.channels;
  const auto values = static_cast<double>(count);
  Benchmark benchmark{"decode_pca", fmt::format("64 x 16384 x 3, rank {}", rank),
                      2 * values * static_cast<double>(rank), 4 * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const std::size_t columns = shape.images * shape.channels;
    const auto A = std::make_shared<Buffer>(
        random_buffer(device, ops::packed_elements(device, rank, shape.texels), "A"));
    const auto B = std::make_shared<Buffer>(random_buffer(device, columns * rank, "B"));
    const auto mean = std::make_shared<Buffer>(random_buffer(device, columns, "mean"));
    const auto out = std::make_shared<Buffer>(device, count * sizeof(float), "out");
    return [=, &device] { ops::decode_pca(device, shape, *A, *B, *mean, *out); };
  };
  return benchmark;
}

}  // namespace

std::vector<Benchmark> decoder_benchmarks() {
  return {pca(16), pca(64)};
}

}  // namespace weft
