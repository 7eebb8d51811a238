// The first pass over an input: means, range, and whether it is fit to be compressed.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/device/tile_stream.hpp"
#include "weft/job.hpp"
#include "weft/ops/tile.hpp"

namespace weft {

struct SourceScan {
  // [N C]: the mean ABRDF, over the texels of each image and channel; zeros where the source has
  // taken a weighted mean from its values.
  std::vector<float> means;
  double largest = 0;  // largest magnitude
};

// Throws an input error that names view, light, texel and channel of the first NaN or infinite
// value, unless job.nan_zero.
SourceScan scan_source(Device& device, TileSource& source, Job& job);

// The power of two that brings the largest magnitude into [0.5, 1); 1 for zero.
float unit_scale(double largest);

// A run of `count` images of a source, for the tile operations.
ops::TileShape tile_shape(const BtfInfo& info, std::size_t count, const Job& job);

}  // namespace weft
