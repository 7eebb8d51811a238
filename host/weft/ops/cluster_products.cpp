#include "weft/ops/cluster_products.hpp"

#include <fmt/core.h>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {
constexpr std::size_t block_rows = 8;
constexpr std::size_t block_vectors = 8;

cl_kernel cluster_kernel(Device& device, const char* name) {
  return device.kernel(
      kernel_sources::cluster_products,
      fmt::format("{} -DROWS={} -DVECTORS={}", vector_option(device), block_rows, block_vectors),
      name);
}
}  // namespace

void centre_clusters(Device& device, const ClusterTables& clusters, std::size_t rows,
                     std::size_t first_row, const Buffer& tile, Buffer& sorted,
                     const ClusterMatrix& W, Buffer& squares) {
  const cl_kernel kernel = cluster_kernel(device, "centre_clusters");
  set_arguments(kernel, ulong(rows), ulong(first_row), ulong(clusters.clusters), ulong(W.n_padded),
                ulong(W.leading), ulong(W.k), clusters.order, clusters.table, clusters.first, tile,
                sorted, *W.buffer, squares);
  launch_items(device, kernel, clusters.clusters, ceil_div(rows, block_rows));
}

void project_clusters(Device& device, const ClusterTables& clusters, std::size_t rows,
                      std::size_t first_row, const Buffer& sorted, const Buffer& U,
                      const ClusterMatrix& W) {
  const cl_kernel kernel = cluster_kernel(device, "project_clusters");
  set_arguments(kernel, ulong(rows), ulong(first_row), ulong(W.n_padded), ulong(W.leading),
                ulong(W.k), clusters.first, sorted, U, *W.buffer);
  launch_items(device, kernel, clusters.clusters, ceil_div(rows, 4));
}

void add_texel_squares(Device& device, std::size_t texels, std::size_t rows, std::size_t first_row,
                       const Buffer& tile, Buffer& squares) {
  const cl_kernel kernel = cluster_kernel(device, "add_texel_squares");
  set_arguments(kernel, ulong(rows), ulong(first_row), tile, squares);
  launch_items(device, kernel, ceil_div(texels, panel_width(device)));
}

void assign_clusters(Device& device, const AssignShape& shape, const Buffer& scores,
                     const Buffer& offsets, const Buffer& squares, Buffer& label, Buffer& error,
                     Buffer& coefficients) {
  const cl_kernel kernel = cluster_kernel(device, "assign_clusters");
  set_arguments(kernel, ulong(shape.clusters), ulong(shape.k), ulong(shape.leading), shape.margin,
                scores, offsets, squares, label, error, coefficients);
  launch_items(device, kernel, ceil_div(shape.leading, 8 * block_vectors));
}

}  // namespace weft::ops
