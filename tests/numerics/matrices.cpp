#include "numerics/matrices.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "support/generators.hpp"
#include "weft/error.hpp"

namespace weft::numerics {
namespace {

using test::Random;

Matrix zeros(std::size_t rows, std::size_t columns) {
  return {rows, columns, std::vector<double>(rows * columns, 0.0)};
}

double rounded(double value, Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? static_cast<double>(static_cast<float>(value)) : value;
}

Matrix rounded(Matrix matrix, Arithmetic arithmetic) {
  for (double& value : matrix.values) value = rounded(value, arithmetic);
  return matrix;
}

Matrix with_singular_values(std::size_t rows, std::size_t columns,
                            const std::vector<double>& values, Arithmetic arithmetic) {
  return rounded({rows, columns, test::matrix_with_singular_values(rows, columns, values, 1)},
                 arithmetic);
}

Matrix random_matrix(std::size_t rows, std::size_t columns, std::uint64_t seed,
                     Arithmetic arithmetic) {
  return rounded({rows, columns, test::random_values(rows * columns, seed, -1.0, 1.0)}, arithmetic);
}

// Integers in [-limit, limit].
Matrix random_integers(std::size_t rows, std::size_t columns, std::uint64_t seed, int limit) {
  Matrix matrix = zeros(rows, columns);
  Random random(seed);
  for (double& value : matrix.values) {
    value = static_cast<double>(random.index(2 * static_cast<std::size_t>(limit) + 1)) - limit;
  }
  return matrix;
}

// Entry of the Hadamard matrix of Sylvester: orthogonal columns of +-1 where sizes are powers of
// two.
double hadamard(std::size_t i, std::size_t j) {
  return std::popcount(i & j) % 2 == 0 ? 1.0 : -1.0;
}

// 256 columns of rank 49: what is not found among so many is lost.
Matrix graded(Arithmetic arithmetic) {
  return with_singular_values(1024, 256, graded_values(), arithmetic);
}

// Three clusters of ten: within 1e-6 of 1, of 1e-2 and of 1e-4.
Matrix clustered(Arithmetic arithmetic) {
  std::vector<double> values;
  for (const double centre : {1.0, 1e-2, 1e-4}) {
    for (int j = 0; j < 10; ++j) values.push_back(centre * (1 - 1e-7 * j));
  }
  return with_singular_values(600, 30, values, arithmetic);
}

// H D G^T / 8 with Hadamard matrices H (512 x 16) and G (64 x 16): eight singular values of
// sqrt(512) and eight of 2^-18 of it, exactly; every entry is exact in float.
Matrix repeated(Arithmetic) {
  Matrix matrix = zeros(512, 64);
  for (std::size_t i = 0; i < 512; ++i) {
    for (std::size_t j = 0; j < 64; ++j) {
      for (std::size_t l = 0; l < 16; ++l) {
        const double value = l < 8 ? 1.0 : 0x1p-18;
        matrix.at(i, j) += hadamard(i, l) * value * hadamard(j, l) / 8;
      }
    }
  }
  return matrix;
}

// A product of integer matrices, 600 x 7 and 7 x 40.
Matrix rank_deficient(Arithmetic) {
  Matrix left = random_integers(600, 7, 2, 3);
  Matrix right = random_integers(7, 40, 3, 3);
  Matrix matrix = zeros(600, 40);
  for (std::size_t i = 0; i < 600; ++i) {
    for (std::size_t j = 0; j < 40; ++j) {
      for (std::size_t l = 0; l < 7; ++l) matrix.at(i, j) += left.at(i, l) * right.at(l, j);
    }
  }
  return matrix;
}

Matrix scaled_rows(Arithmetic arithmetic) {
  Matrix matrix = random_matrix(700, 20, 4, arithmetic);
  for (std::size_t i = 0; i < 700; ++i) {
    // in no order
    const double factor = std::pow(10.0, -30.0 + 60.0 * static_cast<double>(i * 397 % 700) / 699);
    for (std::size_t j = 0; j < 20; ++j) matrix.at(i, j) *= factor;
  }
  return rounded(std::move(matrix), arithmetic);
}

Matrix subnormal(Arithmetic arithmetic) {
  Matrix matrix = random_integers(200, 12, 5, 1000);
  const double step = arithmetic == Arithmetic::f32
                          ? double{std::numeric_limits<float>::denorm_min()}
                          : std::numeric_limits<double>::denorm_min();
  for (double& value : matrix.values) value *= step;
  return matrix;
}

Matrix constant(Arithmetic arithmetic) {
  Matrix matrix = zeros(300, 20);
  std::fill(matrix.values.begin(), matrix.values.end(), rounded(0.3, arithmetic));
  return matrix;
}

// Pairs of columns a and a + delta b of small integers, delta below the root of the roundoff, and
// 40 sums of the a: the differences are exact in the data, and squaring loses them.
Matrix cancellation(Arithmetic arithmetic) {
  const double delta = arithmetic == Arithmetic::f32 ? 0x1p-15 : 0x1p-32;
  Matrix a = random_integers(400, 4, 6, 15);
  Matrix b = random_integers(400, 4, 7, 15);
  Matrix sums = random_integers(4, 40, 11, 2);
  Matrix matrix = zeros(400, 48);
  for (std::size_t i = 0; i < 400; ++i) {
    for (std::size_t j = 0; j < 4; ++j) {
      matrix.at(i, j) = a.at(i, j);
      matrix.at(i, 4 + j) = a.at(i, j) + delta * b.at(i, j);
    }
    for (std::size_t j = 0; j < 40; ++j) {
      for (std::size_t l = 0; l < 4; ++l) matrix.at(i, 8 + j) += a.at(i, l) * sums.at(l, j);
    }
  }
  return matrix;
}

}  // namespace

std::vector<double> graded_values() {
  std::vector<double> values(49);
  for (std::size_t j = 0; j < values.size(); ++j) {
    values[j] = std::pow(10.0, -static_cast<double>(j) / 4);
  }
  return values;
}

Case long_sums(std::size_t rows) {
  const auto make = [rows](Arithmetic arithmetic) {
    Matrix matrix = zeros(rows, 2);
    const double value = rounded(0.1, arithmetic);
    for (std::size_t i = 0; i < rows; ++i) {
      matrix.at(i, 0) = value;
      if (i % 2 == 0) matrix.at(i, 1) = value;
    }
    return matrix;
  };
  return {"long-sums", fmt::format("{} x 2, all 0.1 or 0", rows), make, 2, 1, 2};
}

const std::vector<Case>& cases() {
  static const std::vector<Case> all{
      {"graded", "1024 x 256, singular values from 1 to 1e-12", graded, 49, 9},
      {"clustered", "600 x 30, ten values each within 1e-6 of 1, 1e-2 and 1e-4", clustered, 30, 10},
      {"repeated", "512 x 64, eight values of 1 and eight of 2^-18, exactly", repeated, 16, 8},
      {"rank-deficient", "600 x 40 of rank 7, exactly", rank_deficient, 40, 7},
      {"scaled-rows", "700 x 20, rows scaled from 1e-30 to 1e30", scaled_rows, 20, 1},
      {"subnormal", "200 x 12, small multiples of the smallest number", subnormal, 12, 0},
      {"zero", "50 x 9, all zero", [](Arithmetic) { return zeros(50, 9); }, 9, 0},
      {"constant", "300 x 20, all 0.3", constant, 20, 1},
      {"one-row", "1 x 30", [](Arithmetic a) { return random_matrix(1, 30, 8, a); }, 1, 1},
      {"one-column", "500 x 1", [](Arithmetic a) { return random_matrix(500, 1, 9, a); }, 1, 1},
      {"wide", "20 x 60", [](Arithmetic a) { return random_matrix(20, 60, 10, a); }, 20, 0},
      long_sums(10'000'000),
      {"cancellation", "400 x 48 of rank 8, columns that differ in the last digits", cancellation,
       8, 4},
  };
  return all;
}

const Case& find_case(const std::string& name) {
  for (const Case& c : cases()) {
    if (c.name == name) return c;
  }
  fail_input("there is no case '{}'", name);
}

}  // namespace weft::numerics
