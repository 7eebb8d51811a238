// One operation at one size, to be measured: the rows of `weft bench`, and the work that `weft
// tune` times.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "weft/device/device.hpp"

namespace weft {

// Enqueues the operation once.
using Run = std::function<void()>;

struct Benchmark {
  std::string operation;  // "gemm": what --filter looks at
  std::string shape;      // "2048 x 2048 x 2048"
  double flops = 0;       // of one run; 0 where they are not known
  double bytes = 0;       // that one run has to move
  bool fp64 = false;      // computes in double: for devices that have it
  // Makes the data; the run holds it.
  std::function<Run(Device&)> prepare = nullptr;
};

// One file per family.
std::vector<Benchmark> product_benchmarks();      // matrix products
std::vector<Benchmark> basis_benchmarks();        // inner products, orthonormal bases
std::vector<Benchmark> tile_benchmarks();         // raw tiles
std::vector<Benchmark> cluster_benchmarks();      // clusters of texels
std::vector<Benchmark> dictionary_benchmarks();   // learning of dictionaries
std::vector<Benchmark> decoder_benchmarks();      // images from models
std::vector<Benchmark> render_benchmarks();       // synthesised materials
std::vector<Benchmark> sparse_benchmarks();       // sparse coding
std::vector<Benchmark> code_vector_benchmarks();  // vector quantisation
// All of them, in this order.
std::vector<Benchmark> all_benchmarks();

// Seeded values in [-1, 1) on the device.
Buffer random_buffer(Device& device, std::size_t floats, const char* what);
// The same in double.
Buffer random_doubles(Device& device, std::size_t count, const char* what);
// Zeros.
Buffer zero_buffer(Device& device, std::size_t bytes, const char* what);

}  // namespace weft
