// Matrices on the host for tests of operations: data, layouts, comparisons.
//
// Room that no operation may use is NaN, so that a value taken from there shows.
#pragma once

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "support/generators.hpp"

namespace weft::test {

inline constexpr float unused = std::numeric_limits<float>::quiet_NaN();

inline std::vector<double> widened(std::span<const float> values) {
  return {values.begin(), values.end()};
}

// Values in the arithmetic of a test, rounded to it.
template <typename Real>
std::vector<Real> values_as(std::span<const double> values) {
  std::vector<Real> result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) result[i] = static_cast<Real>(values[i]);
  return result;
}

inline std::vector<double> magnitudes(std::span<const double> values) {
  std::vector<double> result(values.begin(), values.end());
  for (double& value : result) value = std::abs(value);
  return result;
}
inline std::vector<double> magnitudes(std::span<const float> values) {
  return magnitudes(widened(values));
}

// Integers in [-limit, limit]: sums of their products are exact in float below 2^24.
inline std::vector<float> random_integers(std::size_t count, std::uint64_t seed, int limit = 8) {
  Random random(seed);
  std::vector<float> values(count);
  for (float& value : values) {
    value = static_cast<float>(random.index(2 * static_cast<std::size_t>(limit) + 1)) -
            static_cast<float>(limit);
  }
  return values;
}

// Row-major rows x columns at the given leading dimension, behind `offset` unused values; nothing
// follows the last value.
template <typename Real>
std::vector<Real> with_leading(std::span<const Real> matrix, std::size_t rows, std::size_t columns,
                               std::size_t leading, std::size_t offset = 0) {
  std::vector<Real> result(offset + (rows - 1) * leading + columns, Real{unused});
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      result[offset + r * leading + c] = matrix[r * columns + c];
    }
  }
  return result;
}

template <typename Real>
std::vector<Real> transpose(std::span<const Real> matrix, std::size_t rows, std::size_t columns) {
  std::vector<Real> result(matrix.size());
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) result[c * rows + r] = matrix[r * columns + c];
  }
  return result;
}

// Panels [ceil(columns / width)][rows][width]; columns past the last hold `padding`.
template <typename Real>
std::vector<Real> panels_of(std::span<const Real> matrix, std::size_t rows, std::size_t columns,
                            std::size_t width, Real padding) {
  std::vector<Real> result((columns + width - 1) / width * rows * width, padding);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      result[(c / width * rows + r) * width + c % width] = matrix[r * columns + c];
    }
  }
  return result;
}

// The first `columns` columns of panels, row-major.
template <typename Real>
std::vector<Real> from_panels(std::span<const Real> panels, std::size_t rows, std::size_t columns,
                              std::size_t width) {
  std::vector<Real> result(rows * columns);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      result[r * columns + c] = panels[(c / width * rows + r) * width + c % width];
    }
  }
  return result;
}

// Vectors are taken as spans of them.
template <typename Real>
std::vector<Real> with_leading(const std::vector<Real>& matrix, std::size_t rows,
                               std::size_t columns, std::size_t leading, std::size_t offset = 0) {
  return with_leading(std::span<const Real>(matrix), rows, columns, leading, offset);
}
template <typename Real>
std::vector<Real> transpose(const std::vector<Real>& matrix, std::size_t rows,
                            std::size_t columns) {
  return transpose(std::span<const Real>(matrix), rows, columns);
}
template <typename Real>
std::vector<Real> panels_of(const std::vector<Real>& matrix, std::size_t rows, std::size_t columns,
                            std::size_t width, Real padding) {
  return panels_of(std::span<const Real>(matrix), rows, columns, width, padding);
}
template <typename Real>
std::vector<Real> from_panels(const std::vector<Real>& panels, std::size_t rows,
                              std::size_t columns, std::size_t width) {
  return from_panels(std::span<const Real>(panels), rows, columns, width);
}

// The same bits in every place, NaN included.
template <typename T>
testing::AssertionResult same_bits(const std::vector<T>& actual, const std::vector<T>& expected) {
  using Bits = std::conditional_t<sizeof(T) == sizeof(std::uint64_t), std::uint64_t, std::uint32_t>;
  if (actual.size() != expected.size()) {
    return testing::AssertionFailure()
           << actual.size() << " values where " << expected.size() << " are expected";
  }
  for (std::size_t i = 0; i < actual.size(); ++i) {
    if (std::bit_cast<Bits>(actual[i]) != std::bit_cast<Bits>(expected[i])) {
      return testing::AssertionFailure() << "bits differ first at index " << i << ": " << actual[i]
                                         << " where " << expected[i] << " is expected";
    }
  }
  return testing::AssertionSuccess();
}

}  // namespace weft::test
