// Inner products, orthonormal bases and triangular factors.
#include <fmt/core.h>

#include <memory>

#include "bench/benchmark.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/orthonormalise.hpp"
#include "weft/ops/tsqr.hpp"

namespace weft {
namespace {

constexpr std::size_t n = 16384, count = 72;

std::shared_ptr<Buffer> columns(Device& device, const char* what) {
  return std::make_shared<Buffer>(
      random_buffer(device, ops::packed_elements(device, n, count), what));
}

Benchmark inner_products(ops::GramSums sums, const char* name, double flops_per_term) {
  Benchmark benchmark{name, "72 x 72 x 16384", flops_per_term * n * count * count, 4.0 * n * count};
  benchmark.fp64 = sums == ops::GramSums::best;
  benchmark.prepare = [sums](Device& device) -> Run {
    const auto X = columns(device, "X");
    return [=, &device] {
      const ops::Columns all = ops::packed_columns(device, *X, n, count);
      ops::gram(device, n, all, all, sums);
    };
  };
  return benchmark;
}

Run orthonormal_basis(Device& device) {
  const auto X = columns(device, "X");
  const auto scratch = std::make_shared<Buffer>(device, X->size(), "scratch");
  return [=, &device] { ops::orthonormalise(device, n, count, *X, *scratch); };
}

Run projection(Device& device) {
  const auto Q = columns(device, "Q");
  const auto scratch = std::make_shared<Buffer>(device, Q->size(), "scratch");
  ops::orthonormalise(device, n, count, *Q, *scratch);
  const auto Y = columns(device, "Y");
  return [=, &device] { ops::project_out(device, n, *Q, count, *Y, count); };
}

Benchmark triangular_factor(std::size_t rows, std::size_t columns, Arithmetic arithmetic) {
  const double flops = 2.0 * static_cast<double>(rows * columns * columns);
  const double bytes = static_cast<double>(rows * columns * size_of(arithmetic));
  Benchmark benchmark{arithmetic == Arithmetic::f32 ? "tsqr" : "tsqr (double)",
                      fmt::format("{} x {}", rows, columns), flops, bytes};
  benchmark.fp64 = arithmetic == Arithmetic::f64;
  benchmark.prepare = [=](Device& device) -> Run {
    const std::size_t elements =
        rows * ops::round_up(columns, ops::panel_width(device, arithmetic));
    const auto X = std::make_shared<Buffer>(arithmetic == Arithmetic::f32
                                                ? random_buffer(device, elements, "X")
                                                : random_doubles(device, elements, "X"));
    const auto tsqr = std::make_shared<ops::Tsqr>(device, columns, arithmetic);
    return [=] { tsqr->add(*X, rows); };
  };
  return benchmark;
}

}  // namespace

std::vector<Benchmark> basis_benchmarks() {
  return {
      inner_products(ops::GramSums::best, "gram (double)", 2),
      inner_products(ops::GramSums::float_pairs, "gram (pairs of floats)", 2),
      {"orthonormalise", "16384 x 72", 8.0 * n * count * count, 16.0 * n * count, false,
       orthonormal_basis},
      {"project_out", "16384 x 72", 4.0 * n * count * count, 16.0 * n * count, false, projection},
      // whole batches, so that every run reduces its rows
      triangular_factor(65536, 243, Arithmetic::f32),
      triangular_factor(16384, 1024, Arithmetic::f32),
      triangular_factor(65536, 243, Arithmetic::f64),
  };
}

}  // namespace weft
