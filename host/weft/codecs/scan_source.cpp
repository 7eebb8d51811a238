#include "weft/codecs/scan_source.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "weft/reference/tile.hpp"

namespace weft {

SourceScan scan_source(Device& device, TileSource& source, Job& job) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const StageTimer timer(job, "scan", 0, static_cast<double>(info.bytes()));
  SourceScan scan;
  const bool centred = !source.texel_scale().empty();
  scan.means.reserve(shape.images() * shape.channels);
  std::optional<std::size_t> too_large;  // first image of the first tile that holds such a value
  TileStream(device, source, image_granule(shape))
      .for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
        const ops::TileScan tile = ops::scan_tile(device, tile_shape(info, count, job), raw);
        if (tile.largest > reference::largest_magnitude && !too_large) too_large = first;
        if (tile.first_bad && !job.nan_zero && !too_large) {
          reference::fail_non_finite(shape, first * shape.image_values() + *tile.first_bad);
        }
        for (const double sum : tile.sums) {
          const double mean = centred ? 0.0 : sum / static_cast<double>(shape.texels());
          scan.means.push_back(static_cast<float>(mean));
        }
        scan.largest = std::max(scan.largest, static_cast<double>(tile.largest));
        job.advance("scan", first + count, shape.images());
      });
  if (too_large) {
    // The reference's reader names the first value that is not taken.
    std::vector<double> image(shape.image_values());
    for (std::size_t i = *too_large; i < shape.images(); ++i) {
      reference::read_tile(source, i, 1, job.nan_zero, image);
    }
  }
  return scan;
}

float unit_scale(double largest) {
  if (largest == 0) return 1.0f;
  int exponent = 0;
  std::frexp(largest, &exponent);
  // 2^127 is the largest power of two in float: subnormal data is brought as near to 1 as that
  // goes.
  return std::ldexp(1.0f, std::min(-exponent, 127));
}

ops::TileShape tile_shape(const BtfInfo& info, std::size_t count, const Job& job) {
  return {count, info.shape.texels(), info.shape.channels, info.dtype, job.nan_zero};
}

}  // namespace weft
