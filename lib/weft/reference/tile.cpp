#include "weft/reference/tile.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>

#include "weft/btf/encoding.hpp"
#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft::reference {
namespace {
// The i-th value of unaligned raw data.
template <typename T>
T load(std::span<const std::byte> raw, std::size_t i) {
  T value;
  std::memcpy(&value, raw.data() + i * sizeof(T), sizeof(T));
  return value;
}

// Where the value of that index in [V, L, Y, X, C] is.
std::string place_of(const BtfShape& shape, std::size_t at) {
  const std::size_t c = at % shape.channels;
  at /= shape.channels;
  const std::size_t x = at % shape.width;
  at /= shape.width;
  const std::size_t y = at % shape.height;
  at /= shape.height;
  return fmt::format("view {}, light {}, row {}, column {}, channel {}", at / shape.lights,
                     at % shape.lights, y, x, c);
}
}  // namespace

void to_double(DType dtype, std::span<const std::byte> raw, bool nan_zero, std::span<double> out) {
  for (std::size_t i = 0; i < out.size(); ++i) {
    double value = 0;
    if (dtype == DType::u8) {
      value = static_cast<double>(load<std::uint8_t>(raw, i)) / 255.0;
    } else if (dtype == DType::f16) {
      value = static_cast<double>(half_to_float(load<std::uint16_t>(raw, i)));
    } else {
      value = static_cast<double>(load<float>(raw, i));
    }
    out[i] = nan_zero && !std::isfinite(value) ? 0.0 : value;
  }
}

void read_tile(TileSource& source, std::size_t first, std::size_t count, bool nan_zero,
               std::span<double> out) {
  const BtfInfo& info = source.info();
  const std::span<const std::byte> mapped = source.mapped(first, count);
  if (!mapped.empty()) {
    to_double(info.dtype, mapped, nan_zero, out);
  } else {
    std::vector<std::byte> raw(count * info.image_bytes());
    source.read(first, count, raw);
    to_double(info.dtype, raw, nan_zero, out);
  }
  source.release(first, count);
  const auto bad = std::find_if(out.begin(), out.end(),
                                [](double x) { return !(std::abs(x) <= largest_magnitude); });
  if (bad == out.end()) return;
  const std::size_t at =
      first * info.shape.image_values() + static_cast<std::size_t>(bad - out.begin());
  if (!std::isfinite(*bad)) fail_non_finite(info.shape, at);
  fail_input(
      "the input, as selected, holds {:g}, first beyond 2^100 (1.27e30) at {}: larger magnitudes "
      "are not taken",
      *bad, place_of(info.shape, at));
}

void fail_non_finite(const BtfShape& shape, std::size_t at) {
  fail_input(
      "the input, as selected, holds NaN or an infinity, first at {}; --nan zero reads such values "
      "as 0",
      place_of(shape, at));
}

TileScan scan_tile(std::size_t images, std::size_t texels, std::size_t channels,
                   std::span<const double> values) {
  TileScan scan;
  scan.sums.assign(images * channels, 0.0);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      if (!scan.first_bad) scan.first_bad = i;
      continue;
    }
    const std::size_t image = i / (texels * channels);
    scan.sums[image * channels + i % channels] += values[i];
    scan.largest = std::max(scan.largest, std::abs(values[i]));
  }
  return scan;
}

std::vector<double> convert_tile(std::size_t images, std::size_t texels, std::size_t channels,
                                 std::span<const double> values, std::span<const double> mean,
                                 double scale) {
  std::vector<double> rows(values.size());
  for (std::size_t image = 0; image < images; ++image) {
    for (std::size_t p = 0; p < texels; ++p) {
      for (std::size_t c = 0; c < channels; ++c) {
        const std::size_t row = image * channels + c;
        const double value = values[(image * texels + p) * channels + c];
        rows[row * texels + p] = (value - mean[row]) * scale;
      }
    }
  }
  return rows;
}

ErrorSums error_sums(std::span<const double> values, std::span<const double> decoded) {
  ErrorSums sums;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double difference = std::abs(values[i] - decoded[i]);
    sums.merge(
        {1, values[i] * values[i], difference * difference, difference, std::abs(values[i])});
  }
  return sums;
}

LogErrorSums log_error_sums(std::span<const double> values, std::span<const double> decoded,
                            double scale) {
  const auto signed_log = [&](double x) {
    return std::copysign(std::log1p(std::abs(x) / scale), x);
  };
  LogErrorSums sums;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double reference = signed_log(values[i]);
    const double difference = reference - signed_log(decoded[i]);
    sums.merge({1, reference * reference, difference * difference});
  }
  return sums;
}

double transcode(double value, Encoding from, Encoding to, DType dtype) {
  if (from != to) value = encode_from_linear(to, decode_to_linear(from, value));
  if (dtype == DType::u8) return value > 0 ? std::min(value, 1.0) : 0.0;
  if (dtype == DType::f16 && std::isfinite(value)) {
    return std::clamp(value, -double{half_max}, double{half_max});
  }
  return value;
}

}  // namespace weft::reference
