// Images from models.
#include <fmt/core.h>

#include <memory>
#include <span>

#include "bench/benchmark.hpp"
#include "bench/clusters.hpp"
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

Benchmark lpca(std::size_t clusters, std::size_t rank) {
  const std::size_t images = 64, texels = 16384, channels = 3, columns = images * channels;
  const auto values = static_cast<double>(columns * texels);
  Benchmark benchmark{"decode_lpca",
                      fmt::format("64 x 16384 x 3, {} clusters, rank {}", clusters, rank),
                      2 * values * static_cast<double>(rank), 4 * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const ops::ClusterPanels panels = bench_clusters(device, texels, clusters);
    const auto upload = [&](const std::vector<std::uint32_t>& entries) {
      auto buffer =
          std::make_shared<Buffer>(device, entries.size() * sizeof(std::uint32_t), "table");
      device.write(*buffer, std::span<const std::uint32_t>(entries));
      return buffer;
    };
    const auto table = upload(panels.panels);
    const auto slots = upload(panels.slots);
    const auto A = std::make_shared<Buffer>(random_buffer(device, panels.order.size() * rank, "A"));
    const auto B = std::make_shared<Buffer>(random_buffer(device, clusters * columns * rank, "B"));
    const auto mean = std::make_shared<Buffer>(random_buffer(device, clusters * columns, "mean"));
    const auto out = std::make_shared<Buffer>(device, columns * texels * sizeof(float), "out");
    const ops::DecodeLpcaShape shape{images, 0, images, texels, channels, rank, panels.count()};
    const auto sorted =
        std::make_shared<Buffer>(device, ops::decode_lpca_bytes(device, shape), "sorted");
    return [=, &device] {
      ops::decode_lpca(device, shape, *table, *slots, *A, *B, *mean, *sorted, *out);
    };
  };
  return benchmark;
}

}  // namespace

std::vector<Benchmark> decoder_benchmarks() {
  return {pca(16), pca(64), lpca(16, 8), lpca(64, 16)};
}

}  // namespace weft
