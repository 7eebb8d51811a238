// Trials of the decoding of models.
#include <cmath>
#include <cstdint>
#include <memory>
#include <string_view>
#include <utility>

#include "tune/trial.hpp"
#include "weft/ops/decode_lpca.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
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

// A local PCA model with a cluster of scattered texels, one of runs and one of a single texel.
struct SmallLpca {
  static constexpr std::size_t clusters = 3, images = 67, texels = 1061, channels = 3, rank = 5;
  static constexpr std::size_t columns = images * channels;

  explicit SmallLpca(Device& device)
      : a(texels * rank), b(clusters * columns * rank), m(clusters * columns) {
    reference::fill_random(1, a);
    reference::fill_random(2, b);
    reference::fill_random(3, m);
    std::vector<std::uint32_t> label(texels);
    for (std::size_t p = 0; p < texels; ++p) label[p] = p % 3 == 0 || p > 700 ? 1 : 0;
    label[500] = 2;
    const std::size_t width = ops::panel_width(device);
    const ops::ClusterPanels panels = ops::cluster_panels(label, clusters, width);
    shape = {images, 0, images, texels, channels, rank, panels.count()};
    std::vector<float> packed(panels.order.size() * rank, 0.0f);
    for (std::size_t panel = 0; panel < panels.count(); ++panel) {
      for (std::size_t slot = 0; slot < panels.panels[2 * panel + 1]; ++slot) {
        for (std::size_t j = 0; j < rank; ++j) {
          packed[(panel * rank + j) * width + slot] =
              a[panels.order[panel * width + slot] * rank + j];
        }
      }
    }
    table = upload<std::uint32_t>(device, panels.panels);
    slots = upload<std::uint32_t>(device, panels.slots);
    A = upload<float>(device, packed);
    B = upload<float>(device, b);
    mean = upload<float>(device, m);
    sorted = Buffer(device, ops::decode_lpca_bytes(device, shape), "sorted");
    out = Buffer(device, columns * texels * sizeof(float), "out");
    for (std::size_t image = 0; image < images; ++image) {
      for (std::size_t p = 0; p < texels; ++p) {
        for (std::size_t c = 0; c < channels; ++c) {
          const std::size_t row = label[p] * columns + image * channels + c;
          double sum = double{m[row]}, size = std::abs(sum);
          for (std::size_t j = 0; j < rank; ++j) {
            const double term = double{a[p * rank + j]} * double{b[row * rank + j]};
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
    ops::decode_lpca(device, shape, table, slots, A, B, mean, sorted, out);
    std::vector<float> actual(expected.size());
    device.read(out, std::span<float>(actual));
    const double unit = error_bound(rank + 1, float_unit);
    return difference(actual, expected, [&](std::size_t i) { return unit * magnitude[i]; });
  }

  template <typename T>
  static Buffer upload(Device& device, const std::vector<T>& values) {
    Buffer buffer(device, values.size() * sizeof(T), "model");
    device.write(buffer, std::span<const T>(values));
    return buffer;
  }

  ops::DecodeLpcaShape shape;
  std::vector<float> a, b, m;
  Buffer table, slots, A, B, mean, sorted, out;
  std::vector<double> expected, magnitude;
};

template <typename Small>
Trial trial(const TunableKernel& kernel, Benchmark timed) {
  return {&kernel, std::move(timed), [](Device& device) -> Check {
            const auto small = std::make_shared<Small>(device);
            return [small, &device] { return small->check(device); };
          }};
}

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
  return {trial<SmallPca>(tunables::decode_pca, timed("decode_pca", "rank 64")),
          trial<SmallLpca>(tunables::decode_lpca, timed("decode_lpca", "rank 16"))};
}

}  // namespace weft
