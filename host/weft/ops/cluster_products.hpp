// Products over clusters of texels on the device: kernels/cluster_products.cl, which draws the
// layouts.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"

namespace weft::ops {

// A clustering on the device: the three lists of a ClusterPanels of panel_width(device).
struct ClusterTables {
  std::size_t clusters = 0;
  Buffer order;
  Buffer table;
  Buffer first;
};

// W, [clusters][n_padded][leading]: k columns of products, then the mean.
struct ClusterMatrix {
  Buffer* buffer = nullptr;
  std::size_t n_padded = 0;
  std::size_t leading = 0;
  std::size_t k = 0;
};

// Sorts `rows` rows of all texels (packed panels in texel order) by cluster into `sorted`,
// [panels][rows][NR], without the mean of each cluster; means go to column k of W at first_row on,
// sums of squares to squares[first_row + row][cluster].
void centre_clusters(Device& device, const ClusterTables& clusters, std::size_t rows,
                     std::size_t first_row, const Buffer& tile, Buffer& sorted,
                     const ClusterMatrix& W, Buffer& squares);

// Columns j < k of W at first_row on: sums over each cluster's texels of sorted times U, packed
// [panels][k][NR] with zero padding.
void project_clusters(Device& device, const ClusterTables& clusters, std::size_t rows,
                      std::size_t first_row, const Buffer& sorted, const Buffer& U,
                      const ClusterMatrix& W);

// squares[p] += sums over rows of a tile in texel order; set where first_row is 0. `squares` is
// padded to a whole panel.
void add_texel_squares(Device& device, std::size_t texels, std::size_t rows, std::size_t first_row,
                       const Buffer& tile, Buffer& squares);

struct AssignShape {
  std::size_t clusters = 0;
  std::size_t k = 0;
  std::size_t leading = 0;  // texels padded to a multiple of 8
  float margin = 0;         // part of |a|^2 by which another cluster must be nearer
};

// label, error and coefficients of each texel's nearest subspace from scores, offsets and squares.
void assign_clusters(Device& device, const AssignShape& shape, const Buffer& scores,
                     const Buffer& offsets, const Buffer& squares, Buffer& label, Buffer& error,
                     Buffer& coefficients);

}  // namespace weft::ops
