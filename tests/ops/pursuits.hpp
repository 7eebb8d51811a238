// What orthogonal matching pursuit must be, for its tests: every atom is the best one of its step,
// coefficients are least squares, and pursuits end where they should.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "weft/ops/batch_omp.hpp"

namespace weft::test {

struct Problem {
  std::size_t atoms = 1;
  std::size_t dimension = 1;
  std::vector<float> D;
  std::vector<float> Y;

  std::size_t signals() const { return Y.size() / dimension; }
};

struct Codes {
  std::vector<std::uint32_t> indices;
  std::vector<float> coefficients;
  std::vector<std::uint32_t> counts;
  std::vector<float> residuals;
  std::size_t recoded = 0;
};

// All ways of computing it.
std::vector<ops::OmpOptions> every_way(const OmpTarget& target);
std::string text_of(const ops::OmpOptions& options);

// By the device, between guards.
Codes code(const Problem& problem, const ops::OmpOptions& options);

double norm(std::span<const double> a);

// Roundings that the arithmetic of a code of k atoms sums up in a value.
double terms_of(const Problem& problem, std::size_t k);

// Checks every code, of the device and of the reference; how many have the reference's atoms in its
// order.
std::size_t expect_pursuits(const Problem& problem, const ops::OmpOptions& options);
void expect_every_way(const Problem& problem, const OmpTarget& target);

Problem random_problem(std::size_t atoms, std::size_t dimension, std::size_t signals,
                       std::uint64_t seed);

}  // namespace weft::test
