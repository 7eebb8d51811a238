// Trials of matrix products.
#include <cmath>
#include <memory>

#include "tune/trial.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/matrix_product.hpp"
#include "weft/reference/gemm.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

// C = A B - C/2 across the edges of micro-tiles, macro-tiles and blocks of all legal sizes, with A
// as it is and transposed.
struct SmallProduct {
  static constexpr std::size_t M = 390, N = 221, K = 485;

  explicit SmallProduct(Device& device)
      : host_A(M * K), host_B(K * N), host_C(M * N), expected(M * N), magnitude(M * N) {
    reference::fill_random(1, host_A);
    reference::fill_random(2, host_B);
    reference::fill_random(3, host_C);
    std::vector<double> a(host_A.begin(), host_A.end()), b(host_B.begin(), host_B.end());
    expected.assign(host_C.begin(), host_C.end());
    reference::gemm(M, N, K, 1, a, b, -0.5, expected);
    for (double& value : a) value = std::abs(value);
    for (double& value : b) value = std::abs(value);
    magnitude.assign(host_C.begin(), host_C.end());
    for (double& value : magnitude) value = std::abs(value);
    reference::gemm(M, N, K, 1, a, b, 0.5, magnitude);

    std::vector<float> turned(K * M);
    for (std::size_t i = 0; i < M; ++i) {
      for (std::size_t k = 0; k < K; ++k) turned[k * M + i] = host_A[i * K + k];
    }
    for (const auto& [buffer, values] :
         {std::pair{&A, &host_A}, std::pair{&A_turned, &turned}, std::pair{&B, &host_B}}) {
      *buffer = Buffer(device, values->size() * sizeof(float), "matrix");
      device.write(*buffer, std::span<const float>(*values));
    }
    C = Buffer(device, M * N * sizeof(float), "matrix");
  }

  std::string check(Device& device) {
    for (const bool transposed : {false, true}) {
      device.write(C, std::span<const float>(host_C));
      const ops::Operand a =
          transposed ? ops::transposed(device, A_turned, M) : ops::row_major(device, A, K);
      ops::gemm(device, M, N, K, 1, a, ops::row_major(device, B, N), -0.5,
                ops::to_row_major(device, C, N));
      std::vector<float> actual(M * N);
      device.read(C, std::span<float>(actual));
      std::string wrong = difference_of(actual);
      if (!wrong.empty()) return wrong;
    }
    return {};
  }

  // The same by the kernels for GPUs.
  std::string check_tiles(Device& device) {
    for (const bool transposed : {false, true}) {
      device.write(C, std::span<const float>(host_C));
      ops::gemm(device, transposed ? ops::Transpose::yes : ops::Transpose::no, ops::Transpose::no,
                M, N, K, 1, {transposed ? A_turned : A, transposed ? M : K}, {B, N}, -0.5, {C, N},
                {Arithmetic::f32, ops::Family::tiles, 1});
      std::vector<float> actual(M * N);
      device.read(C, std::span<float>(actual));
      std::string wrong = difference_of(actual);
      if (!wrong.empty()) return wrong;
    }
    return {};
  }

  std::string difference_of(const std::vector<float>& actual) const {
    const double unit = error_bound(K + 3, float_unit);
    return difference(actual, expected, [&](std::size_t i) { return unit * magnitude[i]; });
  }

  std::vector<float> host_A, host_B, host_C;
  std::vector<double> expected, magnitude;
  Buffer A, A_turned, B, C;
};

Benchmark product(const std::string& operation, const std::string& shape) {
  for (Benchmark& benchmark : product_benchmarks()) {
    if (benchmark.operation == operation && benchmark.shape == shape) return std::move(benchmark);
  }
  return {};
}

}  // namespace

std::vector<Trial> product_trials() {
  return {{&tunables::gemm, product("gemm", "2048 x 2048 x 2048"),
           [](Device& device) -> Check {
             const auto small = std::make_shared<SmallProduct>(device);
             return [small, &device] { return small->check(device); };
           }},
          {&tunables::gemm_tiled, product("gemm (tiles)", "512 x 512 x 512"),
           [](Device& device) -> Check {
             const auto small = std::make_shared<SmallProduct>(device);
             return [small, &device] { return small->check_tiles(device); };
           }}};
}

}  // namespace weft
