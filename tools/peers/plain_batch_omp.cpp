#include "plain_batch_omp.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace weft::peers {

void plain_set_threads(int threads) {
  omp_set_num_threads(threads);
}

void plain_batch_omp(std::size_t signals, std::size_t atoms, std::size_t k, const float* alpha0,
                     const float* G, std::uint32_t* indices, float* coefficients) {
  const auto last = static_cast<std::ptrdiff_t>(signals);
#pragma omp parallel
  {
    std::vector<float> alpha(atoms);
    std::vector<float> L(k * k);  // lower triangle of the Cholesky factor of G's chosen part
    std::vector<float> w(k);
    std::vector<float> x(k);
    std::vector<std::size_t> chosen(k);
#pragma omp for schedule(static)
    for (std::ptrdiff_t signal = 0; signal < last; ++signal) {
      const std::size_t s = static_cast<std::size_t>(signal);
      const float* start = alpha0 + s * atoms;
      std::copy(start, start + atoms, alpha.begin());
      for (std::size_t t = 0; t < k; ++t) {
        // the best atom
        std::size_t best = 0;
        float largest = -1;
        for (std::size_t n = 0; n < atoms; ++n) {
          if (std::abs(alpha[n]) > largest) {
            largest = std::abs(alpha[n]);
            best = n;
          }
        }
        // the next row of L
        float diagonal = G[best * atoms + best];
        for (std::size_t i = 0; i < t; ++i) {
          float sum = G[best * atoms + chosen[i]];
          for (std::size_t j = 0; j < i; ++j) sum -= L[i * k + j] * w[j];
          w[i] = sum / L[i * k + i];
          diagonal -= w[i] * w[i];
        }
        for (std::size_t i = 0; i < t; ++i) L[t * k + i] = w[i];
        L[t * k + t] = std::sqrt(diagonal);
        chosen[t] = best;
        // L L^T x = alpha0 of the chosen
        for (std::size_t i = 0; i <= t; ++i) {
          float sum = start[chosen[i]];
          for (std::size_t j = 0; j < i; ++j) sum -= L[i * k + j] * x[j];
          x[i] = sum / L[i * k + i];
        }
        for (std::size_t i = t + 1; i-- > 0;) {
          float sum = x[i];
          for (std::size_t j = i + 1; j <= t; ++j) sum -= L[j * k + i] * x[j];
          x[i] = sum / L[i * k + i];
        }
        if (t + 1 == k) break;
        // alpha = alpha0 - G x
        std::copy(start, start + atoms, alpha.begin());
        for (std::size_t j = 0; j <= t; ++j) {
          const float* g = G + chosen[j] * atoms;
          for (std::size_t n = 0; n < atoms; ++n) alpha[n] -= g[n] * x[j];
        }
      }
      for (std::size_t j = 0; j < k; ++j) {
        indices[s * k + j] = static_cast<std::uint32_t>(chosen[j]);
        coefficients[s * k + j] = x[j];
      }
    }
  }
}

}  // namespace weft::peers
