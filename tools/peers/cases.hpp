// The products that are compared, with their data.
//
//   gemm:  C = A B        A: M x K, B: K x N, C: M x N
//   syrk:  C += A A^T     A: M x K in chunks of columns, C: M x M, its lower triangle
//
// All matrices are row-major. A chunk of a syrk is M x `chunk`, contiguous, and stands for all K /
// chunk of them: memory stays small, and every product reads as much as with data of its own, since
// a chunk is larger than the caches.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace weft::peers {

enum class Operation { gemm, syrk };

struct Case {
  std::string name;  // "sgemm 2048", what --filter looks at
  Operation operation = Operation::gemm;
  std::size_t M = 0, N = 0, K = 0;
  std::size_t chunk = 0;  // columns of A at a time; divides K
  bool fp64 = false;

  std::size_t chunks() const { return chunk == 0 ? 1 : K / chunk; }
  std::size_t columns() const { return chunk == 0 ? K : chunk; }
  // As a BLAS counts them: a syrk computes one triangle.
  double flops() const;
  std::string shape() const;
};

std::vector<Case> all_cases();

// Seeded values in [-1, 1); as double as well where a case needs that.
struct Matrices {
  explicit Matrices(const Case& c);
  std::vector<float> A, B;
  std::vector<double> A64, B64;
};

// The elements of C that a case defines, row by row: all, or the lower triangle. A contender's
// result of another type is converted.
using Elements = std::vector<double>;

// Largest |x(i, j) - y(i, j)| / (2 gamma |a_i| |b_j|) of two results, where gamma = K u / (1 - K u)
// bounds the error of any order of summation: at most 1 if both are right.
double disagreement(const Case& c, const Matrices& matrices, const Elements& x, const Elements& y);

}  // namespace weft::peers
