// Sparse coding: pursuits among 256 atoms, from correlations that are there and from signals.
#include <fmt/core.h>

#include <memory>

#include "bench/benchmark.hpp"
#include "weft/ops/batch_omp.hpp"

namespace weft {
namespace {

constexpr std::size_t signals = 100000, atoms = 256, dimension = 300;

struct SparseData {
  SparseData(Device& device, std::size_t k)
      : Y(random_buffer(device, signals * dimension, "signals")),
        indices(device, signals * k * sizeof(std::uint32_t), "indices"),
        coefficients(device, signals * k * sizeof(float), "coefficients"),
        counts(device, signals * sizeof(std::uint32_t), "counts"),
        omp(device, atoms, dimension, {.target = {k, 0}}),
        C(device, signals * omp.row_of_correlations() * sizeof(float), "correlations") {
    omp.set_dictionary({random_buffer(device, atoms * dimension, "atoms"), dimension});
    omp.correlate(signals, {Y, dimension}, C);
    device.finish();
  }

  Buffer Y, indices, coefficients, counts;
  ops::BatchOmp omp;
  Buffer C;
};

// In step t < k - 1, t + 1 products and sums with all correlations.
double pursuit_flops(std::size_t k) {
  return static_cast<double>(signals * atoms * k * (k - 1));
}
double code_bytes(std::size_t k) {
  return static_cast<double>(signals * (8 * k + 4));
}

Benchmark pursuit(std::size_t k) {
  return {"omp_pursuit",
          fmt::format("{} x {}, k {}", signals, atoms, k),
          pursuit_flops(k),
          static_cast<double>(signals * (atoms + dimension) * sizeof(float)) + code_bytes(k),
          false,
          [k](Device& device) -> Run {
            const auto data = std::make_shared<SparseData>(device, k);
            return [data] {
              data->omp.code_correlated(signals, {data->Y, dimension}, data->C,
                                        {data->indices, data->coefficients, data->counts});
            };
          }};
}

Benchmark coding(std::size_t k) {
  return {"omp_code",
          fmt::format("{} x {} x {}, k {}", signals, atoms, dimension, k),
          2.0 * static_cast<double>(signals * atoms * dimension) + pursuit_flops(k),
          static_cast<double>(signals * dimension * sizeof(float)) + code_bytes(k),
          false,
          [k](Device& device) -> Run {
            const auto data = std::make_shared<SparseData>(device, k);
            return [data] {
              data->omp.code(signals, {data->Y, dimension},
                             {data->indices, data->coefficients, data->counts});
            };
          }};
}

}  // namespace

std::vector<Benchmark> sparse_benchmarks() {
  std::vector<Benchmark> benchmarks;
  for (const std::size_t k : {5, 10, 16}) {
    benchmarks.push_back(pursuit(k));
    benchmarks.push_back(coding(k));
  }
  return benchmarks;
}

}  // namespace weft
