#include "support/generators.hpp"

#include <cmath>
#include <cstring>
#include <numbers>
#include <stdexcept>

#include "weft/btf/directions.hpp"
#include "weft/tensor/half.hpp"

namespace weft::test {

double Random::uniform() {
  return static_cast<double>(engine_() >> 11) * 0x1p-53;
}

double Random::normal() {
  // Box and Muller; 1 - u is never 0.
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  return radius * std::cos(2.0 * std::numbers::pi * uniform());
}

std::size_t Random::index(std::size_t limit) {
  return static_cast<std::size_t>(uniform() * static_cast<double>(limit));
}

std::vector<double> random_values(std::size_t count, std::uint64_t seed, double low, double high) {
  Random random(seed);
  std::vector<double> values(count);
  for (double& value : values) value = random.uniform(low, high);
  return values;
}

std::vector<float> random_floats(std::size_t count, std::uint64_t seed, double low, double high) {
  const std::vector<double> values = random_values(count, seed, low, high);
  return {values.begin(), values.end()};
}

std::vector<double> random_orthonormal(std::size_t rows, std::size_t columns, std::uint64_t seed) {
  if (columns > rows) throw std::invalid_argument("more orthonormal columns than rows");
  Random random(seed);
  std::vector<double> q(rows * columns);
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t r = 0; r < rows; ++r) q[r * columns + c] = random.normal();
    // Gram and Schmidt, twice: the second pass removes what rounding left of the first.
    for (int pass = 0; pass < 2; ++pass) {
      for (std::size_t other = 0; other < c; ++other) {
        double dot = 0;
        for (std::size_t r = 0; r < rows; ++r) dot += q[r * columns + c] * q[r * columns + other];
        for (std::size_t r = 0; r < rows; ++r) q[r * columns + c] -= dot * q[r * columns + other];
      }
    }
    double square = 0;
    for (std::size_t r = 0; r < rows; ++r) square += q[r * columns + c] * q[r * columns + c];
    for (std::size_t r = 0; r < rows; ++r) q[r * columns + c] /= std::sqrt(square);
  }
  return q;
}

std::vector<double> matrix_with_singular_values(std::size_t rows, std::size_t columns,
                                                std::span<const double> values,
                                                std::uint64_t seed) {
  const std::size_t k = values.size();
  const std::vector<double> u = random_orthonormal(rows, k, seed);
  const std::vector<double> v = random_orthonormal(columns, k, seed + 1);
  std::vector<double> matrix(rows * columns, 0.0);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t j = 0; j < k; ++j) {
        matrix[r * columns + c] += u[r * k + j] * values[j] * v[c * k + j];
      }
    }
  }
  return matrix;
}

BtfInfo make_info(const BtfShape& shape, DType dtype) {
  BtfInfo info;
  info.shape = shape;
  info.dtype = dtype;
  info.encoding = dtype == DType::u8 ? Encoding::srgb : Encoding::linear;
  info.view_directions = even_directions(shape.views);
  info.light_directions = even_directions(shape.lights);
  info.source = "generated";
  return info;
}

std::vector<std::byte> encode_values(std::span<const double> values, DType dtype) {
  std::vector<std::byte> bytes(values.size() * size_of(dtype));
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (dtype == DType::u8) {
      const double scaled = std::round(255.0 * values[i]);
      bytes[i] = static_cast<std::byte>(std::fmin(std::fmax(scaled, 0.0), 255.0));
    } else if (dtype == DType::f16) {
      const std::uint16_t half = float_to_half(static_cast<float>(values[i]));
      std::memcpy(&bytes[2 * i], &half, 2);
    } else if (dtype == DType::f32) {
      const float single = static_cast<float>(values[i]);
      std::memcpy(&bytes[4 * i], &single, 4);
    } else {
      throw std::invalid_argument("values of a BTF are U8, F16 or F32");
    }
  }
  return bytes;
}

std::vector<double> decode_values(std::span<const std::byte> bytes, DType dtype) {
  std::vector<double> values(bytes.size() / size_of(dtype));
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (dtype == DType::u8) {
      values[i] = static_cast<double>(bytes[i]) / 255.0;
    } else if (dtype == DType::f16) {
      std::uint16_t half = 0;
      std::memcpy(&half, &bytes[2 * i], 2);
      values[i] = static_cast<double>(half_to_float(half));
    } else if (dtype == DType::f32) {
      float single = 0;
      std::memcpy(&single, &bytes[4 * i], 4);
      values[i] = static_cast<double>(single);
    } else {
      throw std::invalid_argument("values of a BTF are U8, F16 or F32");
    }
  }
  return values;
}

}  // namespace weft::test
