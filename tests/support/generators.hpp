// Seeded data for tests. The same seed gives the same numbers with every standard library: only the
// generator is taken from it, not the distributions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft::test {

// for (const std::size_t n : Sizes{1, 23, 24, 25})
using Sizes = std::vector<std::size_t>;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  // In [0, 1), or [low, high).
  double uniform();
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  // Mean 0, variance 1.
  double normal();
  // In [0, limit).
  std::size_t index(std::size_t limit);

 private:
  std::mt19937_64 engine_;
};

std::vector<double> random_values(std::size_t count, std::uint64_t seed, double low = 0.0,
                                  double high = 1.0);
std::vector<float> random_floats(std::size_t count, std::uint64_t seed, double low = 0.0,
                                 double high = 1.0);

// [rows][columns] with orthonormal columns, columns <= rows.
std::vector<double> random_orthonormal(std::size_t rows, std::size_t columns, std::uint64_t seed);

// [rows][columns] = U diag(values) V^T with random orthonormal U and V; at most min(rows, columns)
// values.
std::vector<double> matrix_with_singular_values(std::size_t rows, std::size_t columns,
                                                std::span<const double> values, std::uint64_t seed);

// A valid BtfInfo of that shape, its directions spread evenly.
BtfInfo make_info(const BtfShape& shape, DType dtype = DType::f32);

// Values as a tensor of U8 (value 255, rounded and clamped), F16 or F32, and back.
std::vector<std::byte> encode_values(std::span<const double> values, DType dtype);
std::vector<double> decode_values(std::span<const std::byte> bytes, DType dtype);

}  // namespace weft::test
