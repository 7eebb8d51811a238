// Clusters of texels, as local PCA has them: what they are fitted with, and their decoding.
#include "bench/clusters.hpp"

#include <fmt/core.h>

#include <memory>
#include <span>
#include <vector>

#include "bench/benchmark.hpp"
#include "weft/ops/cluster_products.hpp"
#include "weft/ops/decode_lpca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

constexpr std::size_t texels = 16384, rows = 192, clusters = 16, rank = 8;
constexpr double values = static_cast<double>(texels * rows);

template <typename T>
Buffer table_of(Device& device, const std::vector<T>& entries) {
  const std::vector<std::uint32_t> narrow(entries.begin(), entries.end());
  Buffer buffer(device, narrow.size() * sizeof(std::uint32_t), "table");
  device.write(buffer, std::span<const std::uint32_t>(narrow));
  return buffer;
}

// Clusters in runs of 64 texels, and a tile of rows of all texels.
struct ClusterData {
  explicit ClusterData(Device& device)
      : padded(ops::round_up(texels, ops::panel_width(device))),
        tile(random_buffer(device, padded * rows, "tile")),
        squares(device, padded * sizeof(float), "squares") {
    const ops::ClusterPanels panels = bench_clusters(device, texels, clusters);
    const std::size_t slots = panels.count() * ops::panel_width(device);
    tables.clusters = clusters;
    tables.order = table_of(device, panels.order);
    tables.table = table_of(device, panels.panels);
    tables.first = table_of(device, panels.first);
    sorted = Buffer(device, slots * rows * sizeof(float), "sorted");
    U = random_buffer(device, slots * rank, "U");
    const std::size_t leading = ops::round_up(rank + 1, ops::panel_width(device));
    W = zero_buffer(device, clusters * rows * leading * sizeof(float), "W");
    row_squares = Buffer(device, rows * clusters * sizeof(float), "squares");
    matrix = {&W, rows, leading, rank};
  }

  std::size_t padded;
  Buffer tile, squares, sorted, U, W, row_squares;
  ops::ClusterTables tables;
  ops::ClusterMatrix matrix;
};

Run centre(Device& device) {
  const auto data = std::make_shared<ClusterData>(device);
  return [=, &device] {
    ops::centre_clusters(device, data->tables, rows, 0, data->tile, data->sorted, data->matrix,
                         data->row_squares);
  };
}

Run project(Device& device) {
  const auto data = std::make_shared<ClusterData>(device);
  ops::centre_clusters(device, data->tables, rows, 0, data->tile, data->sorted, data->matrix,
                       data->row_squares);
  return [=, &device] {
    ops::project_clusters(device, data->tables, rows, 0, data->sorted, data->U, data->matrix);
  };
}

Run texel_squares(Device& device) {
  const auto data = std::make_shared<ClusterData>(device);
  return
      [=, &device] { ops::add_texel_squares(device, texels, rows, 0, data->tile, data->squares); };
}

Run assign(Device& device) {
  const std::size_t products = clusters * (rank + 1);
  const auto scores = std::make_shared<Buffer>(random_buffer(device, products * texels, "scores"));
  const auto offsets = std::make_shared<Buffer>(random_buffer(device, products, "offsets"));
  const auto squares = std::make_shared<Buffer>(random_buffer(device, texels, "squares"));
  const auto label =
      std::make_shared<Buffer>(zero_buffer(device, texels * sizeof(std::uint32_t), "labels"));
  const auto error = std::make_shared<Buffer>(device, texels * sizeof(float), "errors");
  const auto coefficients =
      std::make_shared<Buffer>(device, texels * rank * sizeof(float), "coefficients");
  return [=, &device] {
    ops::assign_clusters(device, {clusters, rank, texels, 1e-6f}, *scores, *offsets, *squares,
                         *label, *error, *coefficients);
  };
}

}  // namespace

ops::ClusterPanels bench_clusters(const Device& device, std::size_t texel_count,
                                  std::size_t cluster_count) {
  std::vector<std::uint32_t> label(texel_count);
  for (std::size_t p = 0; p < texel_count; ++p) {
    label[p] = static_cast<std::uint32_t>(p / 64 % cluster_count);
  }
  return ops::cluster_panels(label, cluster_count, ops::panel_width(device));
}

std::vector<Benchmark> cluster_benchmarks() {
  const char* shape = "16384 x 192, 16 clusters";
  const double scores = 4.0 * texels * clusters * (rank + 1);
  return {
      {"centre_clusters", shape, 4 * values, 8 * values, false, centre},
      {"project_clusters", "16384 x 192, 16 clusters, rank 8", 2 * values * rank, 4 * values, false,
       project},
      {"add_texel_squares", "16384 x 192", 2 * values, 4 * values, false, texel_squares},
      {"assign_clusters", "16384 texels, 16 clusters, rank 8", 3.0 * texels * clusters * (rank + 1),
       scores, false, assign},
  };
}

}  // namespace weft
