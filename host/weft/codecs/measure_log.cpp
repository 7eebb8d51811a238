#include "weft/codecs/measure_log.hpp"

#include <algorithm>
#include <vector>

#include "weft/codecs/scan_source.hpp"
#include "weft/error.hpp"
#include "weft/ops/log_error_sums.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

constexpr const char* stage = "measure log errors";

LogErrorSums on_device(Device& device, DeviceDecoder& decoder, TileSource& raw, double scale,
                       Job& job) {
  const BtfInfo& info = raw.info();
  const BtfShape& shape = info.shape;
  TileStream stream(device, raw, image_granule(shape));
  Buffer decoded(device, stream.granule() * shape.image_values() * sizeof(float), "decoded images");
  LogErrorSums sums;
  stream.for_each([&](std::size_t first, std::size_t count, const Buffer& values) {
    decoder.decode(first, count, decoded);
    sums.merge(ops::log_error_sums(device, tile_shape(info, count, job), values, decoded, scale));
    job.advance(stage, first + count, shape.images());
  });
  return sums;
}

LogErrorSums by_reference(ReferenceDecoder& decoder, TileSource& raw, double scale, Job& job) {
  const BtfShape& shape = raw.info().shape;
  const std::size_t granule = image_granule(shape);
  std::vector<double> decoded(granule * shape.image_values());
  std::vector<double> values(decoded.size());
  LogErrorSums sums;
  for (std::size_t first = 0; first < shape.images(); first += granule) {
    check_interrupt();
    const std::size_t count = std::min(granule, shape.images() - first);
    const std::span<double> images = std::span(decoded).first(count * shape.image_values());
    const std::span<double> originals = std::span(values).first(images.size());
    decoder.decode(first, count, images);
    reference::read_tile(raw, first, count, job.nan_zero, originals);
    sums.merge(reference::log_error_sums(originals, images, scale));
    job.advance(stage, first + count, shape.images());
  }
  return sums;
}

}  // namespace

void measure_log_errors(Device* device, const Model& model, TileSource& raw, LogErrorRequest& log,
                        Job& job) {
  const Codec& codec = find_codec(model.info.codec);
  const StageTimer timer(job, stage, 0, static_cast<double>(raw.info().bytes()));
  log.sums = device ? on_device(*device, *codec.decoder(*device, model), raw, log.scale, job)
                    : by_reference(*codec.reference_decoder(model), raw, log.scale, job);
}

}  // namespace weft
