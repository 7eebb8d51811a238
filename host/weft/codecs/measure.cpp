#include "weft/codecs/measure.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "weft/codecs/scan_source.hpp"
#include "weft/ops/ssim.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

double peak_of(DType dtype, double largest) {
  if (dtype == DType::u8) return 1.0;
  return largest > 0 ? largest : 1.0;
}

// The largest magnitude, by the reference.
double scan_largest(TileSource& raw, const Job& job) {
  const BtfShape& shape = raw.info().shape;
  const std::size_t granule = image_granule(shape);
  std::vector<double> values(granule * shape.image_values());
  double largest = 0;
  for (std::size_t first = 0; first < shape.images(); first += granule) {
    const std::size_t count = std::min(granule, shape.images() - first);
    const std::span<double> tile = std::span(values).first(count * shape.image_values());
    reference::read_tile(raw, first, count, job.nan_zero, tile);
    largest = std::max(largest,
                       reference::scan_tile(count, shape.texels(), shape.channels, tile).largest);
  }
  return largest;
}

// [P][C]: a texel's weight for each of its channels.
Buffer texel_weight_buffer(Device& device, const BtfShape& shape, const Weights& weights) {
  std::vector<float> values;
  values.reserve(shape.image_values());
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    values.insert(values.end(), shape.channels, static_cast<float>(weights.texel(p)));
  }
  Buffer buffer(device, values.size() * sizeof(float), "weights of texels");
  device.write(buffer, std::span<const float>(values));
  return buffer;
}

// What the weights leave as it is: the maxima, and how many values there are.
void add_maxima(const ErrorSums& errors, ErrorSums& weighted) {
  weighted.merge({errors.count, 0, 0, errors.max_difference, errors.max_reference});
}

// A model of nothing: zeros.
class NoImages final : public ReferenceDecoder {
 public:
  void decode(std::size_t, std::size_t, std::span<double> out) override {
    std::fill(out.begin(), out.end(), 0.0);
  }
};

class NoDeviceImages final : public DeviceDecoder {
 public:
  NoDeviceImages(Device& device, const BtfShape& shape) : device_(device), shape_(shape) {}
  void decode(std::size_t, std::size_t count, Buffer& out) override {
    device_.fill_zero(out, 0, count * shape_.image_values() * sizeof(float));
  }
  double image_flops() const override { return 0; }

 private:
  Device& device_;
  BtfShape shape_;
};

}  // namespace

ErrorSums measure_errors(Device& device, DeviceDecoder& decoder, TileSource& raw, Job& job,
                         SimilarityRequest* similarity, WeightedErrors* weighted) {
  const BtfInfo& info = raw.info();
  const BtfShape& shape = info.shape;
  // 8-bit and half values can be squared in float as they are.
  const bool wants_peak = similarity && similarity->peak == 0;
  const bool scans = info.dtype == DType::f32 || (wants_peak && info.dtype != DType::u8);
  const double largest = scans ? scan_source(device, raw, job).largest : 0;
  const float scale = info.dtype == DType::f32 ? unit_scale(largest) : 1.0f;
  if (wants_peak) similarity->peak = peak_of(info.dtype, largest);
  const StageTimer timer(job, "measure",
                         decoder.image_flops() * static_cast<double>(shape.images()),
                         static_cast<double>(info.bytes()));
  TileStream stream(device, raw, image_granule(shape));
  Buffer decoded(device, stream.granule() * shape.image_values() * sizeof(float), "decoded images");
  const Buffer texel_weights =
      weighted ? texel_weight_buffer(device, shape, weighted->weights) : Buffer();
  ErrorSums sums;
  stream.for_each([&](std::size_t first, std::size_t count, const Buffer& values) {
    decoder.decode(first, count, decoded);
    const ops::TileShape tile = tile_shape(info, count, job);
    const ErrorSums errors = ops::error_sums(device, tile, values, decoded, scale);
    sums.merge(errors);
    if (weighted) {
      const std::vector<ops::WeightedSquares> squares =
          ops::weighted_squares(device, tile, values, decoded, texel_weights, scale);
      for (std::size_t i = 0; i < count; ++i) {
        const double w = weighted->weights.image(first + i, shape.lights);
        weighted->sums.square_reference += w * squares[i].reference;
        weighted->sums.square_difference += w * squares[i].difference;
      }
      add_maxima(errors, weighted->sums);
    }
    if (similarity) {
      for (const double ssim :
           ops::ssim(device, tile, shape.width, values, decoded, similarity->peak)) {
        similarity->sums.add(ssim);
      }
    }
    job.advance("measure", first + count, shape.images());
  });
  return sums;
}

ErrorSums measure_errors(ReferenceDecoder& decoder, TileSource& raw, Job& job,
                         SimilarityRequest* similarity, WeightedErrors* weighted) {
  const BtfInfo& info = raw.info();
  const BtfShape& shape = info.shape;
  if (similarity && similarity->peak == 0) {
    similarity->peak = peak_of(info.dtype, info.dtype == DType::u8 ? 1.0 : scan_largest(raw, job));
  }
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
    if (similarity) add_similarities(shape, count, values, decoded, *similarity);
    if (weighted) add_weighted_errors(shape, first, count, values, decoded, *weighted);
    job.advance("measure (reference)", first + count, shape.images());
  }
  return sums;
}

void add_weighted_errors(const BtfShape& shape, std::size_t first, std::size_t images,
                         std::span<const double> raw, std::span<const double> decoded,
                         WeightedErrors& weighted) {
  const std::size_t values = shape.image_values();
  for (std::size_t i = 0; i < images; ++i) {
    ErrorSums errors;
    for (std::size_t p = 0; p < shape.texels(); ++p) {
      const std::size_t at = i * values + p * shape.channels;
      ErrorSums texel = reference::error_sums(raw.subspan(at, shape.channels),
                                              decoded.subspan(at, shape.channels));
      const double w = weighted.weights.texel(p);
      texel.square_reference *= w;
      texel.square_difference *= w;
      errors.merge(texel);
    }
    const double w = weighted.weights.image(first + i, shape.lights);
    errors.square_reference *= w;
    errors.square_difference *= w;
    weighted.sums.merge(errors);
  }
}

ErrorSums sums_of(Device* device, TileSource& raw, Job& job, WeightedErrors* weighted) {
  if (!device) {
    NoImages none;
    return measure_errors(none, raw, job, nullptr, weighted);
  }
  NoDeviceImages none(*device, raw.info().shape);
  const ErrorSums sums = measure_errors(*device, none, raw, job, nullptr, weighted);
  if (!std::isfinite(sums.square_reference)) scan_source(*device, raw, job);
  return sums;
}

void add_similarities(const BtfShape& shape, std::size_t images, std::span<const double> raw,
                      std::span<const double> decoded, SimilarityRequest& similarity) {
  const std::size_t values = shape.image_values();
  for (std::size_t image = 0; image < images; ++image) {
    similarity.sums.add(ssim(shape.height, shape.width, shape.channels,
                             raw.subspan(image * values, values),
                             decoded.subspan(image * values, values), similarity.peak));
  }
}

double psnr_peak(const BtfInfo& info, const ErrorSums& sums) {
  return peak_of(info.dtype, sums.max_reference);
}

}  // namespace weft
