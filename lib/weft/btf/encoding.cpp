#include "weft/btf/encoding.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

double decode_magnitude(Encoding encoding, double u) {
  switch (encoding) {
    case Encoding::srgb:
      return u <= 0.04045 ? u / 12.92 : std::pow((u + 0.055) / 1.055, 2.4);
    case Encoding::gamma22:
      return std::pow(u, 2.2);
    case Encoding::linear:
      break;
  }
  return u;
}

double encode_magnitude(Encoding encoding, double linear) {
  switch (encoding) {
    case Encoding::srgb:
      return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    case Encoding::gamma22:
      return std::pow(linear, 1 / 2.2);
    case Encoding::linear:
      break;
  }
  return linear;
}

template <typename T>
T load(std::span<const std::byte> values, std::size_t index) {
  T value;
  std::memcpy(&value, values.data() + index * sizeof(T), sizeof(T));
  return value;
}

template <typename T>
void store(std::span<std::byte> values, std::size_t index, T value) {
  std::memcpy(values.data() + index * sizeof(T), &value, sizeof(T));
}

std::uint16_t half_of(double value, std::string_view where) {
  // 65520 is the first that rounds past the largest half.
  if (std::isfinite(value) && std::abs(value) >= 65520) {
    fail_input("{}: value {} is beyond the range of F16 ({})", where, value, half_max);
  }
  return float_to_half(static_cast<float>(value));
}

void store_as(DType dtype, std::span<std::byte> out, std::size_t index, double value,
              std::string_view where) {
  if (dtype == DType::u8) {
    store(out, index, nearest_byte(value));
  } else if (dtype == DType::f16) {
    store(out, index, half_of(value, where));
  } else {
    store(out, index, static_cast<float>(value));
  }
}

}  // namespace

double decode_to_linear(Encoding encoding, double stored) {
  return std::copysign(decode_magnitude(encoding, std::abs(stored)), stored);
}

double encode_from_linear(Encoding encoding, double linear) {
  return std::copysign(encode_magnitude(encoding, std::abs(linear)), linear);
}

std::array<float, 256> linear_of_bytes(Encoding encoding) {
  std::array<float, 256> table;
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = static_cast<float>(decode_to_linear(encoding, static_cast<double>(i) / 255));
  }
  return table;
}

unsigned char nearest_byte(double value) {
  if (!(value > 0)) return 0;
  return static_cast<unsigned char>(std::lround(std::min(value, 1.0) * 255));
}

void convert_values(Representation from, std::span<const std::byte> values, Representation to,
                    std::span<std::byte> out, std::string_view where) {
  const std::size_t count = values.size() / size_of(from.dtype);
  if (out.size() != count * size_of(to.dtype)) {
    fail_runtime("{}: {} values of {} don't fit {} bytes of {}", where, count, name_of(from.dtype),
                 out.size(), name_of(to.dtype));
  }
  if (from == to) {
    std::memcpy(out.data(), values.data(), values.size());
    return;
  }
  const bool recode = from.encoding != to.encoding;
  const auto converted = [&](double value) {
    return recode ? encode_from_linear(to.encoding, decode_to_linear(from.encoding, value)) : value;
  };
  if (from.dtype == DType::u8) {
    // 256 values: convert each once.
    std::array<std::array<std::byte, 4>, 256> table{};
    const std::size_t size = size_of(to.dtype);
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const double value = converted(static_cast<double>(byte) / 255);
      store_as(to.dtype, table[byte], 0, value, where);
    }
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(out.data() + i * size, table[std::to_integer<std::size_t>(values[i])].data(),
                  size);
    }
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    const float value = from.dtype == DType::f16 ? half_to_float(load<std::uint16_t>(values, i))
                                                 : load<float>(values, i);
    store_as(to.dtype, out, i, converted(static_cast<double>(value)), where);
  }
}

}  // namespace weft
