#include "weft/codecs/measure.hpp"

#include <algorithm>
#include <vector>

#include "weft/codecs/scan_source.hpp"
#include "weft/reference/tile.hpp"

namespace weft {

ErrorSums measure_errors(Device& device, DeviceDecoder& decoder, TileSource& raw, Job& job) {
  const BtfInfo& info = raw.info();
  const BtfShape& shape = info.shape;
  // 8-bit and half values can be squared in float as they are.
  const float scale =
      info.dtype == DType::f32 ? unit_scale(scan_source(device, raw, job).largest) : 1.0f;
  const StageTimer timer(job, "measure",
                         decoder.image_flops() * static_cast<double>(shape.images()),
                         static_cast<double>(info.bytes()));
  TileStream stream(device, raw, image_granule(shape));
  Buffer decoded(device, stream.granule() * shape.image_values() * sizeof(float), "decoded images");
  ErrorSums sums;
  stream.for_each([&](std::size_t first, std::size_t count, const Buffer& values) {
    decoder.decode(first, count, decoded);
    sums.merge(ops::error_sums(device, tile_shape(info, count, job), values, decoded, scale));
    job.advance("measure", first + count, shape.images());
  });
  return sums;
}

ErrorSums measure_errors(ReferenceDecoder& decoder, TileSource& raw, Job& job) {
  const BtfInfo& info = raw.info();
  const BtfShape& shape = info.shape;
  const StageTimer timer(job, "measure (reference)", 0, static_cast<double>(info.bytes()));
  const std::size_t granule = image_granule(shape);
  std::vector<double> decoded(granule * shape.image_values());
  std::vector<double> values(decoded.size());
  ErrorSums sums;
  for (std::size_t first = 0; first < shape.images(); first += granule) {
    const std::size_t count = std::min(granule, shape.images() - first);
    const std::size_t size = count * shape.image_values();
    decoder.decode(first, count, std::span(decoded).first(size));
    reference::read_tile(raw, first, count, job.nan_zero, std::span(values).first(size));
    sums.merge(reference::error_sums(std::span<const double>(values).first(size),
                                     std::span<const double>(decoded).first(size)));
    job.advance("measure (reference)", first + count, shape.images());
  }
  return sums;
}

double psnr_peak(const BtfInfo& info, const ErrorSums& sums) {
  if (info.dtype == DType::u8) return 1.0;
  return sums.max_reference > 0 ? sums.max_reference : 1.0;
}

}  // namespace weft
