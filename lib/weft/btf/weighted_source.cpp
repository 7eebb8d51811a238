#include "weft/btf/weighted_source.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "weft/btf/encoding.hpp"
#include "weft/tensor/half.hpp"

namespace weft {

WeightedSource::WeightedSource(TileSource& source, const Weights& weights, bool centred,
                               bool nan_zero)
    : source_(source), info_(source.info()), nan_zero_(nan_zero) {
  const BtfShape& shape = info_.shape;
  info_.dtype = DType::f32;
  const Weights roots = square_roots(weights);
  for (std::size_t i = 0; i < shape.images(); ++i) {
    images_.push_back(static_cast<float>(roots.image(i, shape.lights)));
  }
  texels_.assign(roots.texels.begin(), roots.texels.end());
  if (centred && !texels_.empty()) {
    weights_ = weights.texels;
    means_.assign(shape.images() * shape.channels, 0.0f);
  }
}

void WeightedSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const BtfShape& shape = info_.shape;
  values_.resize(shape.image_values());
  for (std::size_t i = first; i < first + count; ++i) {
    std::span<const std::byte> raw = source_.mapped(i, 1);
    if (raw.empty()) {
      raw_.resize(source_.info().image_bytes());
      source_.read(i, 1, raw_);
      raw = raw_;
    }
    to_floats(raw, values_);
    if (!means_.empty()) subtract_mean(i, values_);
    const float factor = images_[i];
    if (texels_.empty()) {
      for (float& value : values_) value *= factor;
    } else {
      float* value = values_.data();
      for (const float texel : texels_) {
        for (std::size_t c = 0; c < shape.channels; ++c) *value++ *= factor * texel;
      }
    }
    std::memcpy(out.data() + (i - first) * info_.image_bytes(), values_.data(),
                info_.image_bytes());
  }
}

std::size_t WeightedSource::bytes() const {
  return (images_.size() + texels_.size() + means_.size()) * sizeof(float) +
         weights_.size() * sizeof(double) + info_.image_bytes() + source_.info().image_bytes();
}

void WeightedSource::to_floats(std::span<const std::byte> raw, std::span<float> out) const {
  const BtfInfo& from = source_.info();
  if (from.dtype != DType::f16) {
    convert_values({from.dtype, from.encoding}, raw, {DType::f32, from.encoding},
                   std::as_writable_bytes(out), from.source);
    return;
  }
  constexpr std::size_t run = 4096;
  std::vector<std::uint16_t> halves(std::min(run, out.size()));
  for (std::size_t begin = 0; begin < out.size(); begin += run) {
    const std::size_t size = std::min(run, out.size() - begin);
    std::memcpy(halves.data(), raw.data() + begin * sizeof(std::uint16_t),
                size * sizeof(std::uint16_t));
    half_to_float(std::span<const std::uint16_t>(halves).first(size), out.subspan(begin, size));
  }
}

// NaN and infinite values have no part in the means, and stay for the reader to name.
void WeightedSource::subtract_mean(std::size_t image, std::span<float> values) {
  const std::size_t C = info_.shape.channels;
  for (std::size_t c = 0; c < C; ++c) {
    double sum = 0;
    double weight = 0;
    for (std::size_t p = 0; p < weights_.size(); ++p) {
      float& value = values[p * C + c];
      if (nan_zero_ && !std::isfinite(value)) value = 0.0f;
      if (std::isfinite(value)) sum += weights_[p] * double{value};
      weight += weights_[p];
    }
    const float mean = static_cast<float>(sum / weight);
    means_[image * C + c] = mean;
    for (std::size_t p = 0; p < weights_.size(); ++p) values[p * C + c] -= mean;
  }
}

}  // namespace weft
