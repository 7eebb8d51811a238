// Matrix products and Gram matrices.
#include <fmt/core.h>

#include <memory>
#include <string>

#include "bench/benchmark.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/ops/mode_product.hpp"
#include "weft/ops/syrk.hpp"

namespace weft {
namespace {

Buffer random_matrix(Device& device, std::size_t elements, Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? random_buffer(device, elements, "matrix")
                                       : random_doubles(device, elements, "matrix");
}

// C = A B of row-major matrices, packing included.
Benchmark product(std::size_t M, std::size_t N, std::size_t K,
                  Arithmetic arithmetic = Arithmetic::f32) {
  const auto m = static_cast<double>(M), n = static_cast<double>(N), k = static_cast<double>(K);
  const std::size_t size = size_of(arithmetic);
  Benchmark benchmark{arithmetic == Arithmetic::f32 ? "gemm" : "gemm (double)",
                      fmt::format("{} x {} x {}", M, N, K), 2 * m * n * k,
                      static_cast<double>(size) * (m * k + k * n + m * n)};
  benchmark.fp64 = arithmetic == Arithmetic::f64;
  benchmark.prepare = [=](Device& device) -> Run {
    const auto A = std::make_shared<Buffer>(random_matrix(device, M * K, arithmetic));
    const auto B = std::make_shared<Buffer>(random_matrix(device, K * N, arithmetic));
    const auto C = std::make_shared<Buffer>(device, M * N * size, "C");
    return [=, &device] {
      ops::gemm(device, M, N, K, 1, ops::row_major(device, *A, K, 0, arithmetic),
                ops::row_major(device, *B, N, 0, arithmetic), 0,
                ops::to_row_major(device, *C, N, 0, arithmetic));
    };
  };
  return benchmark;
}

// The same with the kernels for GPUs.
Benchmark tiled_product(std::size_t n) {
  const auto size = static_cast<double>(n);
  Benchmark benchmark{"gemm (tiles)", fmt::format("{} x {} x {}", n, n, n), 2 * size * size * size,
                      12 * size * size};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto A = std::make_shared<Buffer>(random_buffer(device, n * n, "A"));
    const auto B = std::make_shared<Buffer>(random_buffer(device, n * n, "B"));
    const auto C = std::make_shared<Buffer>(device, n * n * sizeof(float), "C");
    return [=, &device] {
      ops::gemm(device, ops::Transpose::no, ops::Transpose::no, n, n, n, 1, {*A, n}, {*B, n}, 0,
                {*C, n}, {Arithmetic::f32, ops::Family::tiles, 1});
    };
  };
  return benchmark;
}

// C += X^T X of packed panels: K rows and m columns.
Benchmark gram_matrix(std::size_t m, std::size_t K, Arithmetic arithmetic = Arithmetic::f32) {
  const auto columns = static_cast<double>(m), rows = static_cast<double>(K);
  const std::size_t size = size_of(arithmetic);
  Benchmark benchmark{arithmetic == Arithmetic::f32 ? "syrk_packed" : "syrk_packed (double)",
                      fmt::format("{} x {}", m, K), columns * (columns + 1) * rows,
                      static_cast<double>(size) * (columns * rows + columns * columns)};
  benchmark.fp64 = arithmetic == Arithmetic::f64;
  benchmark.prepare = [=](Device& device) -> Run {
    const auto X = std::make_shared<Buffer>(
        random_matrix(device, ops::packed_elements(device, K, m, arithmetic), arithmetic));
    const auto C = std::make_shared<Buffer>(zero_buffer(device, m * m * size, "C"));
    return [=, &device] { ops::syrk_packed(device, m, K, 1, *X, 1, *C, m, arithmetic); };
  };
  return benchmark;
}

// C = X X^T of m long rows.
Benchmark long_rows(std::size_t m, std::size_t K) {
  const auto rows = static_cast<double>(m), columns = static_cast<double>(K);
  Benchmark benchmark{"syrk_rows", fmt::format("{} x {}", m, K), rows * (rows + 1) * columns,
                      4.0 * rows * columns};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto X = std::make_shared<Buffer>(random_buffer(device, m * K, "X"));
    const auto C = std::make_shared<Buffer>(device, m * m * sizeof(float), "C");
    return [=, &device] {
      ops::syrk(device, ops::Triangle::lower, ops::Transpose::no, m, K, 1, {*X, K}, 0, {*C, m},
                {Arithmetic::f32, ops::Family::panels, 1});
    };
  };
  return benchmark;
}

std::string view_text(const ops::ModeView& view) {
  return fmt::format("{} x {} x {}", view.outer, view.size, view.inner);
}

// T_(n) T_(n)^T of a tensor [outer][n][inner].
Benchmark mode_gram(const ops::ModeView& view) {
  const auto values = static_cast<double>(view.elements());
  Benchmark benchmark{"mode_gram", view_text(view), values * static_cast<double>(view.size + 1),
                      4.0 * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto T = std::make_shared<Buffer>(random_buffer(device, view.elements(), "T"));
    const auto G = std::make_shared<ops::ModeGram>(device, view.size, Arithmetic::f32);
    return [=] { G->add(*T, view); };
  };
  return benchmark;
}

// T x_n U^T.
Benchmark mode_product(const ops::ModeView& view, std::size_t rank) {
  const auto values = static_cast<double>(view.elements());
  const std::size_t out = view.outer * rank * view.inner;
  Benchmark benchmark{"mode_product", fmt::format("{}, rank {}", view_text(view), rank),
                      2.0 * values * static_cast<double>(rank),
                      4.0 * (values + static_cast<double>(out))};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto T = std::make_shared<Buffer>(random_buffer(device, view.elements(), "T"));
    const auto U = std::make_shared<Buffer>(random_buffer(device, view.size * rank, "U"));
    const auto W = std::make_shared<Buffer>(device, out * sizeof(float), "W");
    return [=, &device] {
      ops::mode_product(device, view, *T, ops::ModeProduct::project, *U, rank, *W);
    };
  };
  return benchmark;
}

// The two products of a pass of an encoder over one run of images.
constexpr std::size_t texels = 16384, rows = 192, block = 72;
constexpr double pass_flops = 2.0 * texels * rows * block;
constexpr double pass_bytes = 4.0 * (texels * (rows + block) + rows * block);

Run images_times_basis(Device& device) {
  const std::size_t padded = ops::round_up(texels, ops::panel_width(device));
  const auto tile = std::make_shared<Buffer>(random_buffer(device, padded * rows, "tile"));
  const auto Q = std::make_shared<Buffer>(
      random_buffer(device, ops::packed_elements(device, texels, block), "Q"));
  const auto W = std::make_shared<Buffer>(device, rows * block * sizeof(float), "W");
  return [=, &device] {
    ops::gemm_packed(device, rows, block, texels, 1, ops::panelled(device, *tile, rows), *Q, 0,
                     ops::to_row_major(device, *W, block));
  };
}

Run texels_from_images(Device& device) {
  const std::size_t padded = ops::round_up(texels, ops::panel_width(device));
  const auto tile = std::make_shared<Buffer>(random_buffer(device, padded * rows, "tile"));
  const auto W = std::make_shared<Buffer>(random_buffer(device, rows * block, "W"));
  const auto Y = std::make_shared<Buffer>(zero_buffer(device, texels * block * sizeof(float), "Y"));
  return [=, &device] {
    ops::gemm_packed(device, block, texels, rows, 1, ops::transposed(device, *W, block), *tile, 1,
                     ops::to_row_major(device, *Y, texels));
  };
}

}  // namespace

std::vector<Benchmark> product_benchmarks() {
  return {
      product(512, 512, 512),
      product(2048, 2048, 2048),
      product(2001, 2001, 2001),
      product(100000, 256, 300),
      product(100000, 300, 64),
      product(1024, 1024, 1024, Arithmetic::f64),
      tiled_product(512),
      gram_matrix(2048, 2048),
      gram_matrix(81, 250000),
      gram_matrix(243, 130000),
      gram_matrix(1024, 1024, Arithmetic::f64),
      long_rows(81, 250000),
      mode_gram({1, 81, 15552}),
      mode_gram({81, 81, 192}),
      mode_gram({256, 128, 128}),
      mode_gram({32768, 128, 1}),
      mode_product({1, 81, 15552}, 75),
      mode_product({75, 81, 192}, 54),
      mode_product({256, 128, 128}, 100),
      mode_product({32768, 128, 1}, 100),
      {"gemm, W = A^T Q", "192 x 72 x 16384", pass_flops, pass_bytes, false, images_times_basis},
      {"gemm, Y^T += W^T A^T", "72 x 16384 x 192", pass_flops, pass_bytes, false,
       texels_from_images},
  };
}

}  // namespace weft
