#include "weft/codecs/colour_source.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <utility>

#include "weft/error.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

using Kind = ColourTransform::Kind;

// Calls work(image) with every image in double, [P][C].
void for_each_image(TileSource& source, Job& job,
                    const std::function<void(std::span<double> image)>& work) {
  const BtfInfo& info = source.info();
  const StageTimer timer(job, "colour transform", 0, static_cast<double>(info.bytes()));
  std::vector<double> image(info.shape.image_values());
  for (std::size_t i = 0; i < info.shape.images(); ++i) {
    check_interrupt();
    reference::read_tile(source, i, 1, job.nan_zero, image);
    work(image);
    job.advance("colour transform", i + 1, info.shape.images());
  }
}

// Y of linear RGB: what logluv takes the logarithm of.
double luminance(std::span<const double> texel) {
  return 0.2126 * texel[0] + 0.7152 * texel[1] + 0.0722 * texel[2];
}

void fail_negative(const BtfShape& shape, std::size_t image, std::size_t at, double value) {
  const std::size_t p = at / shape.channels;
  fail_input(
      "--transform logluv: the input, as selected, holds {:g}, first below 0 at view {}, light {}, "
      "row {}, column {}, channel {}: it has no colour; --transform log takes such values",
      value, image / shape.lights, image % shape.lights, p / shape.width, p % shape.width,
      at % shape.channels);
}

// The mean magnitude, and the largest of values or of luminances.
void choose_scale(TileSource& source, ColourTransform& transform, Job& job) {
  const BtfShape& shape = source.info().shape;
  const bool of_colours = transform.kind == Kind::logluv;
  double sum = 0, largest = 0;
  std::size_t index = 0;
  for_each_image(source, job, [&](std::span<double> image) {
    double image_sum = 0;
    for (std::size_t i = 0; i < image.size(); ++i) {
      if (of_colours && image[i] < 0) fail_negative(shape, index, i, image[i]);
      image_sum += std::abs(image[i]);
      if (!of_colours) largest = std::max(largest, std::abs(image[i]));
    }
    for (std::size_t i = 0; of_colours && i < image.size(); i += 3) {
      largest = std::max(largest, luminance(image.subspan(i, 3)));
    }
    sum += image_sum;
    ++index;
  });
  const double mean = sum / static_cast<double>(shape.values());
  // what is representable, and inverts within float
  transform.scale = sum > 0 ? std::max({mean, largest * 0x1p-100, 0x1p-126}) : 1.0;
  transform.largest = largest;
}

// Rows are the eigenvectors of the covariance.
void choose_axes(TileSource& source, ColourTransform& transform, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t channels = shape.channels;
  std::vector<double> sums(channels, 0.0), products(channels * channels, 0.0);
  for_each_image(source, job, [&](std::span<double> image) {
    std::vector<double> image_sums(channels, 0.0), image_products(channels * channels, 0.0);
    for (std::size_t i = 0; i < image.size(); i += channels) {
      for (std::size_t c = 0; c < channels; ++c) {
        image_sums[c] += image[i + c];
        for (std::size_t k = 0; k <= c; ++k) {
          image_products[c * channels + k] += image[i + c] * image[i + k];
        }
      }
    }
    for (std::size_t c = 0; c < channels; ++c) sums[c] += image_sums[c];
    for (std::size_t c = 0; c < products.size(); ++c) products[c] += image_products[c];
  });
  const double count = static_cast<double>(shape.images() * shape.texels());
  double trace = 0;
  for (std::size_t c = 0; c < channels; ++c) {
    for (std::size_t k = 0; k <= c; ++k) {
      products[c * channels + k] =
          products[c * channels + k] / count - (sums[c] / count) * (sums[k] / count);
    }
    trace += std::abs(products[c * channels + c]);
  }
  // magnitudes near 1 for the eigensolver
  if (trace > 0) {
    for (double& product : products) product /= trace;
  }
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(channels, products);
  transform.axes.resize(channels * channels);
  for (std::size_t j = 0; j < channels; ++j) {
    std::size_t largest = 0;
    for (std::size_t c = 0; c < channels; ++c) {
      const double component = eigen.vectors[c * channels + j];
      transform.axes[j * channels + c] = component;
      if (std::abs(component) > std::abs(transform.axes[j * channels + largest])) largest = c;
    }
    if (transform.axes[j * channels + largest] >= 0) continue;
    for (std::size_t c = 0; c < channels; ++c) transform.axes[j * channels + c] *= -1;
  }
}

}  // namespace

ColourTransform choose_colour_transform(TileSource& source, const ColourRequest& request,
                                        Job& job) {
  ColourTransform transform;
  transform.kind = request.kind;
  transform.weights = request.weights;
  const std::size_t channels = source.info().shape.channels;
  if (!request.weights.empty() && request.weights.size() != channels) {
    fail_input("--channel-weights: {} weights for {} channels", request.weights.size(), channels);
  }
  if (std::all_of(request.weights.begin(), request.weights.end(),
                  [](double weight) { return weight == 1; })) {
    transform.weights.clear();
  }
  if (transform.mixes_channels() && transform.kind != Kind::decorrelated && channels != 3) {
    fail_input("--transform {}: three channels, R, G and B, are needed, the input has {}",
               name_of(transform.kind), channels);
  }
  if (!transform.is_linear()) choose_scale(source, transform, job);
  if (transform.kind == Kind::decorrelated) choose_axes(source, transform, job);
  validate(transform, channels, "--transform");
  if (!transform.is_identity()) {
    job.held.push_back({"colour transform", TransformedSource::bytes(source.info().shape)});
  }
  return transform;
}

double mean_magnitude(TileSource& source, Job& job) {
  ColourTransform log;
  log.kind = Kind::log;
  choose_scale(source, log, job);
  return log.scale;
}

TransformedSource::TransformedSource(TileSource& source, ColourTransform transform, bool nan_zero)
    : source_(source),
      transform_(std::move(transform)),
      nan_zero_(nan_zero),
      info_(source.info()),
      image_(source.info().shape.image_values()),
      values_(image_.size()) {
  info_.dtype = DType::f32;
}

void TransformedSource::give(std::size_t texels, std::span<std::byte> out) {
  const std::size_t channels = info_.shape.channels;
  const std::span<double> values = std::span(image_).first(texels * channels);
  for (std::size_t p = 0; p < values.size(); p += channels) {
    transform_.apply(values.subspan(p, channels));
  }
  std::transform(values.begin(), values.end(), values_.begin(),
                 [](double value) { return static_cast<float>(value); });
  std::memcpy(out.data(), values_.data(), out.size());
}

void TransformedSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  for (std::size_t i = 0; i < count; ++i) {
    reference::read_tile(source_, first + i, 1, nan_zero_, image_);
    give(info_.shape.texels(), out.subspan(i * info_.image_bytes(), info_.image_bytes()));
  }
}

bool TransformedSource::read_part(std::size_t image, std::size_t first, std::size_t count,
                                  std::span<std::byte> out) {
  const BtfInfo& given = source_.info();
  const std::size_t texel_bytes = given.shape.channels * size_of(given.dtype);
  std::span<const std::byte> raw = source_.mapped(image, 1);
  std::vector<std::byte> part;
  if (!raw.empty()) {
    raw = raw.subspan(first * texel_bytes, count * texel_bytes);
  } else {
    part.resize(count * texel_bytes);
    if (!source_.read_part(image, first, count, part)) return false;
    raw = part;
  }
  reference::to_double(given.dtype, raw, nan_zero_,
                       std::span(image_).first(count * given.shape.channels));
  give(count, out);
  return true;
}

void TransformedSource::prefetch(std::size_t first, std::size_t count) {
  source_.prefetch(first, count);
}

void TransformedSource::release(std::size_t first, std::size_t count) {
  source_.release(first, count);
}

}  // namespace weft
