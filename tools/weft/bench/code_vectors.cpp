// Nearest code-vectors of vector quantisation: of noise, and of vectors that lie in clusters of
// different contrast as slices of materials do; with and without skipping code-vectors by their
// norms. Then the most similar ones.
#include <fmt/core.h>

#include <memory>
#include <span>

#include "bench/benchmark.hpp"
#include "weft/ops/nearest_code_vector.hpp"
#include "weft/ops/similar_code_vector.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

struct Size {
  VectorShape shape;
  std::size_t vectors = 0, code_vectors = 0;

  std::string text() const {
    return fmt::format("{} x {} x {}", vectors, code_vectors, shape.values());
  }
  double products() const {
    return 2.0 * static_cast<double>(vectors * code_vectors * shape.values());
  }
  double bytes() const {
    return static_cast<double>((vectors + code_vectors) * shape.values() * sizeof(float));
  }
};

struct VectorData {
  std::vector<float> rows, scales, means, deviations, code_vectors;
  ScaledVectors vectors() const { return {rows, scales, means, deviations}; }
};

// Contrasts of code-vectors from 0 to 2 about a luminance of 1 and about no colour.
std::shared_ptr<VectorData> vector_data(const Size& size, bool clustered) {
  auto data = std::make_shared<VectorData>();
  const std::size_t width = size.shape.values();
  data->code_vectors.resize(size.code_vectors * width);
  data->rows.resize(size.vectors * width);
  reference::fill_random(1, data->code_vectors);
  reference::fill_random(2, data->rows);
  data->scales.assign(size.vectors, 1.0F);
  const auto ground = [&](std::size_t k) { return k < size.shape.luminances ? 1.0F : 0.0F; };
  for (std::size_t j = 0; j < size.code_vectors; ++j) {
    const float contrast =
        clustered ? 2.0F * static_cast<float>(j) / static_cast<float>(size.code_vectors) : 1.0F;
    for (std::size_t k = 0; k < width; ++k) {
      float& value = data->code_vectors[j * width + k];
      value = ground(k) + contrast * value;
    }
  }
  for (std::size_t i = 0; i < size.vectors; ++i) {
    const std::size_t like = i * 7919 % size.code_vectors;
    for (std::size_t k = 0; k < width; ++k) {
      float& value = data->rows[i * width + k];
      value = clustered ? data->code_vectors[like * width + k] + 0.02F * value : ground(k) + value;
    }
  }
  data->means = data->rows;
  data->deviations.assign(data->rows.size(), 0.1F);
  return data;
}

template <typename Search, typename... Options>
Benchmark search(const char* operation, const Size& size, bool clustered, double flops,
                 Options... options) {
  return {operation,
          fmt::format("{}, {}", size.text(), clustered ? "clusters" : "noise"),
          flops,
          size.bytes(),
          false,
          [=](Device& device) -> Run {
            const auto data = vector_data(size, clustered);
            const auto code_book = std::make_shared<Search>(device, options...);
            code_book->set(size.shape, data->code_vectors);
            return [=] { code_book->nearest(data->vectors(), any_distance); };
          }};
}

}  // namespace

std::vector<Benchmark> code_vector_benchmarks() {
  std::vector<Benchmark> benchmarks;
  // slices, hemispheres of lights and apparent BRDFs
  for (const Size& size : {Size{{11, 0}, 40000, 20000}, Size{{121, 242}, 8000, 4000},
                           Size{{13552, 27104}, 192, 384}}) {
    for (const bool clustered : {true, false}) {
      benchmarks.push_back(search<ops::DeviceNearestSearch>("nearest_code_vector", size, clustered,
                                                            size.products(), true));
      benchmarks.push_back(search<ops::DeviceNearestSearch>("nearest_unpruned", size, clustered,
                                                            size.products(), false));
    }
  }
  for (const Size& size :
       {Size{{11, 0}, 4000, 1000}, Size{{121, 242}, 2000, 1000}, Size{{13552, 27104}, 96, 96}}) {
    for (const bool clustered : {true, false}) {
      benchmarks.push_back(
          search<ops::DeviceSimilarSearch>("similar_code_vector", size, clustered, 0));
    }
  }
  return benchmarks;
}

}  // namespace weft
