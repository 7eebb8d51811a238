// Trials of the decoding of models.
#include <cmath>
#include <memory>
#include <string_view>
#include <utility>

#include "tune/trial.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

// A model across the edges of blocks of all legal sizes.
struct SmallPca {
  static constexpr ops::DecodePcaShape shape{0, 67, 411, 3, 5};
  static constexpr std::size_t columns = shape.images * shape.channels;

  explicit SmallPca(Device& device)
      : A(device, ops::packed_elements(device, shape.rank, shape.texels) * sizeof(float), "A"),
        B(device, columns * shape.rank * sizeof(float), "B"),
        mean(device, columns * sizeof(float), "mean"),
        out(device, columns * shape.texels * sizeof(float), "out") {
    std::vector<float> a(shape.rank * shape.texels), b(columns * shape.rank), m(columns);
    reference::fill_random(1, a);
    reference::fill_random(2, b);
    reference::fill_random(3, m);
    Buffer rows(device, a.size() * sizeof(float), "A");
    device.write(rows, std::span<const float>(a));
    ops::pack_panels(device, ops::row_major(device, rows, shape.texels), shape.rank, shape.texels,
                     A);
    device.write(B, std::span<const float>(b));
    device.write(mean, std::span<const float>(m));
    device.finish();
    for (std::size_t image = 0; image < shape.images; ++image) {
      for (std::size_t p = 0; p < shape.texels; ++p) {
        for (std::size_t c = 0; c < shape.channels; ++c) {
          const std::size_t column = image * shape.channels + c;
          double sum = double{m[column]}, size = std::abs(sum);
          for (std::size_t j = 0; j < shape.rank; ++j) {
            const double term =
                double{a[j * shape.texels + p]} * double{b[column * shape.rank + j]};
            sum += term;
            size += std::abs(term);
          }
          expected.push_back(sum);
          magnitude.push_back(size);
        }
      }
    }
  }

  std::string check(Device& device) {
    device.fill_zero(out, 0, out.size());
    ops::decode_pca(device, shape, A, B, mean, out);
    std::vector<float> actual(expected.size());
    device.read(out, std::span<float>(actual));
    const double unit = error_bound(shape.rank + 1, float_unit);
    return difference(actual, expected, [&](std::size_t i) { return unit * magnitude[i]; });
  }

  Buffer A, B, mean, out;
  std::vector<double> expected, magnitude;
};

Benchmark timed(std::string_view operation, std::string_view shape_end) {
  for (Benchmark& benchmark : decoder_benchmarks()) {
    if (benchmark.operation == operation && benchmark.shape.ends_with(shape_end)) {
      return std::move(benchmark);
    }
  }
  return {};
}

}  // namespace

std::vector<Trial> decoder_trials() {
  return {{&tunables::decode_pca, timed("decode_pca", "rank 64"), [](Device& device) -> Check {
             const auto small = std::make_shared<SmallPca>(device);
             return [small, &device] { return small->check(device); };
           }}};
}

}  // namespace weft
