// Images and texels from models and raw BTFs.
#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "bench/benchmark.hpp"
#include "bench/clusters.hpp"
#include "weft/btf/directions.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/decode_sparse.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/look_up_factors.hpp"
#include "weft/ops/look_up_raw.hpp"
#include "weft/ops/look_up_sparse.hpp"
#include "weft/ops/shade.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

Benchmark pca(std::size_t rank) {
  const ops::DecodePcaShape shape{0, 64, 16384, 3, rank};
  const std::size_t count = shape.images * shape.texels * shape.channels;
  const auto values = static_cast<double>(count);
  Benchmark benchmark{"decode_pca", fmt::format("64 x 16384 x 3, rank {}", rank),
                      2 * values * static_cast<double>(rank), 4 * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const std::size_t columns = shape.images * shape.channels;
    const auto A = std::make_shared<Buffer>(
        random_buffer(device, ops::packed_elements(device, rank, shape.texels), "A"));
    const auto B = std::make_shared<Buffer>(random_buffer(device, columns * rank, "B"));
    const auto mean = std::make_shared<Buffer>(random_buffer(device, columns, "mean"));
    const auto out = std::make_shared<Buffer>(device, count * sizeof(float), "out");
    return [=, &device] { ops::decode_pca(device, shape, *A, *B, *mean, *out); };
  };
  return benchmark;
}

Benchmark lpca(std::size_t clusters, std::size_t rank) {
  const std::size_t images = 64, texels = 16384, channels = 3, columns = images * channels;
  const auto values = static_cast<double>(columns * texels);
  Benchmark benchmark{"decode_lpca",
                      fmt::format("64 x 16384 x 3, {} clusters, rank {}", clusters, rank),
                      2 * values * static_cast<double>(rank), 4 * values};
  benchmark.prepare = [=](Device& device) -> Run {
    const ops::ClusterPanels panels = bench_clusters(device, texels, clusters);
    const auto upload = [&](const std::vector<std::uint32_t>& entries) {
      auto buffer =
          std::make_shared<Buffer>(device, entries.size() * sizeof(std::uint32_t), "table");
      device.write(*buffer, std::span<const std::uint32_t>(entries));
      return buffer;
    };
    const auto table = upload(panels.panels);
    const auto slots = upload(panels.slots);
    const auto A = std::make_shared<Buffer>(random_buffer(device, panels.order.size() * rank, "A"));
    const auto B = std::make_shared<Buffer>(random_buffer(device, clusters * columns * rank, "B"));
    const auto mean = std::make_shared<Buffer>(random_buffer(device, clusters * columns, "mean"));
    const auto out = std::make_shared<Buffer>(device, columns * texels * sizeof(float), "out");
    const ops::DecodeLpcaShape shape{images, 0, images, texels, channels, rank, panels.count()};
    const auto sorted =
        std::make_shared<Buffer>(device, ops::decode_lpca_bytes(device, shape), "sorted");
    return [=, &device] {
      ops::decode_lpca(device, shape, *table, *slots, *A, *B, *mean, *sorted, *out);
    };
  };
  return benchmark;
}

// Ascending lists of `length` atoms each. Every other entry is the same in a run of 8 lists, as
// neighbouring texels have atoms in common.
std::vector<std::uint32_t> sparse_terms(std::size_t lists, std::size_t length, std::size_t atoms) {
  std::vector<std::uint32_t> terms;
  const std::size_t step = atoms / length;
  for (std::size_t list = 0; list < lists; ++list) {
    for (std::size_t n = 0; n < length; ++n) {
      const std::size_t key = n % 2 == 0 ? list / 8 : list;
      terms.push_back(static_cast<std::uint32_t>(n * step + reference::splitmix64(n, key) % step));
    }
  }
  return terms;
}

std::shared_ptr<Buffer> upload_terms(Device& device, const std::vector<std::uint32_t>& terms) {
  auto buffer = std::make_shared<Buffer>(device, terms.size() * sizeof(std::uint32_t), "terms");
  device.write(*buffer, std::span<const std::uint32_t>(terms));
  return buffer;
}

constexpr std::size_t sparse_atoms = 256;

Benchmark sparse(std::size_t k1, std::size_t k2) {
  const ops::DecodeSparseShape shape{0, 64, 1, 64, 16384, 3, sparse_atoms, sparse_atoms, k1, k2};
  const std::size_t count = shape.images * shape.texels * shape.channels;
  Benchmark benchmark{"decode_sparse", fmt::format("64 x 16384 x 3, k1 {}, k2 {}", k1, k2),
                      2.0 * static_cast<double>(shape.images * shape.channels) *
                          static_cast<double>(shape.texels * k2 + shape.abrdf_atoms * k1),
                      4.0 * static_cast<double>(count)};
  benchmark.prepare = [=](Device& device) -> Run {
    const std::size_t width = ops::vector_width(device);
    const auto V = upload_terms(device, sparse_terms(sparse_atoms, k1, sparse_atoms));
    const auto P = upload_terms(device, sparse_terms(shape.texels, k2, sparse_atoms));
    const auto v = std::make_shared<Buffer>(random_buffer(device, sparse_atoms * k1, "V"));
    const auto p = std::make_shared<Buffer>(random_buffer(device, shape.texels * k2, "P"));
    const auto L = std::make_shared<Buffer>(
        random_buffer(device, ops::sparse_dictionary_floats(width, shape), "L"));
    const auto mean = std::make_shared<Buffer>(
        random_buffer(device, ops::sparse_mean_floats(width, shape), "mean"));
    const auto abrdfs = std::make_shared<Buffer>(
        random_buffer(device, ops::sparse_abrdf_floats(width, shape), "ABRDFs"));
    const auto out = std::make_shared<Buffer>(device, count * sizeof(float), "out");
    return [=, &device] {
      ops::decode_sparse(device, shape, {*V, *v}, {*P, *p}, *L, *mean, *abrdfs, *out);
    };
  };
  return benchmark;
}

constexpr LookupShape filtered{4, 3, 3};
constexpr std::size_t lookup_count = std::size_t{1} << 18;

// Look-ups as a picture asks for them: of neighbouring texels, directions next to each other.
// Sorted ones come image by image.
std::vector<std::uint32_t> random_lookups(const BtfShape& shape, bool sorted) {
  std::vector<float> numbers(lookup_count);
  reference::fill_random(2, numbers);
  if (sorted) std::sort(numbers.begin(), numbers.end());
  std::vector<std::uint32_t> records;
  const auto third = std::bit_cast<std::uint32_t>(1.0f / 3);
  const auto quarter = std::bit_cast<std::uint32_t>(0.25f);
  std::size_t texel = 0;
  for (const float number : numbers) {
    const double unit = (static_cast<double>(number) + 1) / 2;
    const auto image = static_cast<std::size_t>(unit * static_cast<double>(shape.images() - 1));
    texel = (texel * 5 + 12345) % (shape.texels() - shape.width - 1);
    for (const std::size_t t : {texel, texel + 1, texel + shape.width, texel + shape.width + 1}) {
      records.push_back(static_cast<std::uint32_t>(t));
    }
    for (std::size_t tap = 0; tap < 3; ++tap) {
      records.push_back(static_cast<std::uint32_t>((image / shape.lights + tap) % shape.views));
    }
    for (std::size_t tap = 0; tap < 3; ++tap) {
      records.push_back(static_cast<std::uint32_t>((image % shape.lights + tap) % shape.lights));
    }
    records.insert(records.end(), 4, quarter);
    records.insert(records.end(), 6, third);
  }
  return records;
}

std::shared_ptr<Buffer> lookup_buffer(Device& device, const BtfShape& shape, bool sorted) {
  const std::vector<std::uint32_t> records = random_lookups(shape, sorted);
  auto buffer = std::make_shared<Buffer>(device, records.size() * sizeof(std::uint32_t), "records");
  device.write(*buffer, std::span<const std::uint32_t>(records));
  return buffer;
}

Benchmark pca_lookups(std::size_t rank, bool sorted) {
  const BtfShape shape{81, 81, 128, 128, 3};
  Benchmark benchmark{
      "look_up_pca",
      fmt::format("{} of 4 x 3 x 3 taps, rank {}, {}", lookup_count, rank,
                  sorted ? "by image" : "in any order"),
      static_cast<double>(lookup_count) * ops::look_up_flops(filtered, shape.channels, rank),
      static_cast<double>(lookup_count * (filtered.words() + shape.channels) * 4)};
  benchmark.prepare = [=](Device& device) -> Run {
    const std::size_t rows = shape.images() * shape.channels;
    const auto records = lookup_buffer(device, shape, sorted);
    const auto A = std::make_shared<Buffer>(
        random_buffer(device, ops::row_floats(shape.texels(), rank, "A"), "A"));
    const auto B =
        std::make_shared<Buffer>(random_buffer(device, ops::row_floats(rows, rank, "B"), "B"));
    const auto mean = std::make_shared<Buffer>(random_buffer(device, rows, "mean"));
    const auto out =
        std::make_shared<Buffer>(device, lookup_count * shape.channels * sizeof(float), "out");
    return [=, &device] {
      ops::look_up_pca(device, {filtered, shape, lookup_count, *records, *out}, rank, *A, *B,
                       *mean);
    };
  };
  return benchmark;
}

Benchmark sparse_lookups(std::size_t k1, std::size_t k2, ops::TexelLists lists) {
  const BtfShape shape{81, 81, 128, 128, 3};
  const ops::SparseLengths lengths{sparse_atoms, k1, k2};
  Benchmark benchmark{
      "look_up_sparse",
      fmt::format("{} of 4 x 3 x 3 taps, k1 {}, k2 {}, {}", lookup_count, k1, k2,
                  lists == ops::TexelLists::merged ? "lists merged" : "texel by texel"),
      static_cast<double>(lookup_count) *
          ops::look_up_sparse_flops(filtered, shape.channels, lengths),
      static_cast<double>(lookup_count * (filtered.words() + shape.channels) * 4)};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto records = lookup_buffer(device, shape, false);
    const std::vector<std::uint32_t> terms =
        sparse_terms(sparse_atoms * shape.views, k1, sparse_atoms);
    const auto V =
        upload_terms(device, ops::lookup_rows(terms, std::vector<float>(terms.size(), 0.25f), k1));
    const auto P =
        upload_terms(device, ops::end_lists(sparse_terms(shape.texels(), k2, sparse_atoms), k2));
    const auto p = std::make_shared<Buffer>(random_buffer(device, shape.texels() * (k2 + 1), "P"));
    const auto L = std::make_shared<Buffer>(random_buffer(
        device, ops::lookup_dictionary_floats(sparse_atoms, shape.lights, shape.channels), "L"));
    const auto mean =
        std::make_shared<Buffer>(random_buffer(device, shape.images() * shape.channels, "mean"));
    const auto out =
        std::make_shared<Buffer>(device, lookup_count * shape.channels * sizeof(float), "out");
    return [=, &device] {
      ops::look_up_sparse(device, {filtered, shape, lookup_count, *records, *out}, lengths, *V,
                          {*P, *p}, *L, *mean, lists);
    };
  };
  return benchmark;
}

// One look-up reads 36 texels, each from a cache line of its own.
Benchmark raw_lookups(bool sorted) {
  const BtfShape shape{81, 81, 64, 64, 3};
  Benchmark benchmark{"look_up_raw",
                      fmt::format("{} of 4 x 3 x 3 taps, F16, {}", lookup_count,
                                  sorted ? "by image" : "in any order"),
                      0, static_cast<double>(lookup_count * (18 * 64 + filtered.words() * 4 + 12))};
  benchmark.prepare = [=](Device& device) -> Run {
    const auto records = lookup_buffer(device, shape, sorted);
    const auto raw = std::make_shared<Buffer>(zero_buffer(device, shape.values() * 2, "images"));
    const auto out = std::make_shared<Buffer>(
        zero_buffer(device, lookup_count * shape.channels * sizeof(float), "out"));
    return [=, &device] {
      ops::look_up_raw(device, {filtered, shape, lookup_count, *records, *out}, DType::f16, 0,
                       shape.images(), *raw);
    };
  };
  return benchmark;
}

Benchmark directions() {
  Benchmark benchmark{"weigh_directions", fmt::format("{} among 151", lookup_count), 0,
                      static_cast<double>(lookup_count * 48)};
  benchmark.prepare = [](Device& device) -> Run {
    std::vector<float> numbers(2 * lookup_count);
    reference::fill_random(3, numbers);
    std::vector<float> list;
    for (std::size_t i = 0; i < lookup_count; ++i) {
      list.insert(list.end(), {numbers[2 * i], numbers[2 * i + 1], 0.5f, 0.0f});
    }
    const auto in = std::make_shared<Buffer>(device, list.size() * sizeof(float), "directions");
    device.write(*in, std::span<const float>(list));
    const auto out = std::make_shared<Buffer>(
        device, lookup_count * ops::direction_words * sizeof(float), "weights");
    const auto tables =
        std::make_shared<ops::DeviceHemisphere>(device, Hemisphere(ubo151_directions()));
    return [=, &device] { tables->weigh(device, lookup_count, *in, *out); };
  };
  return benchmark;
}

}  // namespace

std::vector<Benchmark> decoder_benchmarks() {
  return {pca(16),
          pca(64),
          lpca(16, 8),
          lpca(64, 16),
          sparse(9, 11),
          pca_lookups(16, false),
          pca_lookups(16, true),
          pca_lookups(64, false),
          sparse_lookups(9, 11, ops::TexelLists::merged),
          sparse_lookups(9, 11, ops::TexelLists::one_by_one),
          raw_lookups(false),
          raw_lookups(true),
          directions()};
}

}  // namespace weft
