#include "bench/benchmark.hpp"

#include <algorithm>
#include <iterator>
#include <span>

#include "weft/reference/random.hpp"

namespace weft {

std::vector<Benchmark> all_benchmarks() {
  std::vector<Benchmark> all;
  for (const auto family : {product_benchmarks, basis_benchmarks, tile_benchmarks,
                            cluster_benchmarks, dictionary_benchmarks, decoder_benchmarks,
                            render_benchmarks, sparse_benchmarks, code_vector_benchmarks}) {
    std::ranges::move(family(), std::back_inserter(all));
  }
  return all;
}

Buffer random_buffer(Device& device, std::size_t floats, const char* what) {
  std::vector<float> values(floats);
  reference::fill_random(1, values);
  Buffer buffer(device, floats * sizeof(float), what);
  device.write(buffer, std::span<const float>(values));
  return buffer;
}

Buffer random_doubles(Device& device, std::size_t count, const char* what) {
  std::vector<float> values(count);
  reference::fill_random(1, values);
  const std::vector<double> wide(values.begin(), values.end());
  Buffer buffer(device, count * sizeof(double), what);
  device.write(buffer, std::span<const double>(wide));
  return buffer;
}

Buffer zero_buffer(Device& device, std::size_t bytes, const char* what) {
  Buffer buffer(device, bytes, what);
  device.fill_zero(buffer, 0, bytes);
  return buffer;
}

}  // namespace weft
