#include "weft/codecs/scan_source.hpp"

#include <algorithm>
#include <cmath>

#include "weft/error.hpp"
#include "weft/reference/tile.hpp"

namespace weft {

SourceScan scan_source(Device& device, TileSource& source, Job& job) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  const StageTimer timer(job, "scan", 0, static_cast<double>(info.bytes()));
  SourceScan scan;
  scan.means.reserve(shape.images() * shape.channels);
  TileStream(device, source, image_granule(shape))
      .for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
        const ops::TileScan tile = ops::scan_tile(device, tile_shape(info, count, job), raw);
        if (tile.first_bad && !job.nan_zero) {
          reference::fail_non_finite(shape, first * shape.image_values() + *tile.first_bad);
        }
        for (const double sum : tile.sums) {
          scan.means.push_back(static_cast<float>(sum / static_cast<double>(shape.texels())));
        }
        scan.largest = std::max(scan.largest, static_cast<double>(tile.largest));
        job.advance("scan", first + count, shape.images());
      });
  // Beyond, sums of values leave the range of float.
  constexpr double largest_magnitude = 0x1p100;
  if (scan.largest > largest_magnitude) {
    fail_input("the input's largest magnitude is {:g}; devices take values up to {:g}",
               scan.largest, largest_magnitude);
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
