#include "bench/model.hpp"

#include <algorithm>
#include <bit>
#include <chrono>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bench/measure.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/error.hpp"
#include "weft/model/kcta.hpp"
#include "weft/model/tt.hpp"
#include "weft/model/tucker.hpp"
#include "weft/model/vq.hpp"
#include "weft/ops/peak.hpp"
#include "weft/reference/random.hpp"
#include "weft/reference/vq_light_sampler.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft {
namespace {

constexpr std::size_t host_texels = 1000;
constexpr std::size_t runs = 3;
// Draws from one slice, where they are coherent.
constexpr std::size_t draws_of_slice = 64;
// Slices that lights are drawn from.
constexpr std::size_t light_slices = 16384, host_light_slices = 128, direct_light_slices = 1 << 15;

// Random texel, view and light, a record each.
std::vector<std::uint32_t> random_records(const BtfShape& shape, std::size_t count) {
  std::vector<std::uint32_t> records;
  records.reserve(3 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t value = reference::splitmix64(1, i);
    records.push_back(static_cast<std::uint32_t>((value >> 32) % shape.texels()));
    records.push_back(static_cast<std::uint32_t>((value & 0xffff) % shape.views));
    records.push_back(static_cast<std::uint32_t>((value >> 16 & 0xffff) % shape.lights));
  }
  return records;
}

std::vector<std::uint32_t> sorted_by_texel(const std::vector<std::uint32_t>& records) {
  std::vector<std::size_t> order(records.size() / 3);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(
      order, [&](std::size_t a, std::size_t b) { return records[3 * a] < records[3 * b]; });
  std::vector<std::uint32_t> sorted;
  sorted.reserve(records.size());
  for (const std::size_t i : order) {
    for (std::size_t word = 0; word < 3; ++word) sorted.push_back(records[3 * i + word]);
  }
  return sorted;
}

// Random texels, views and lights of equal weights.
std::vector<std::uint32_t> random_filtered(const LookupShape& lookup, const BtfShape& shape,
                                           std::size_t count) {
  std::vector<std::uint32_t> records;
  records.reserve(lookup.words() * count);
  std::uint64_t drawn = 0;
  const auto add = [&](std::size_t taps, std::size_t limit) {
    for (std::size_t t = 0; t < taps; ++t) {
      const std::uint64_t value = reference::splitmix64(2, drawn++) >> 32;
      records.push_back(static_cast<std::uint32_t>(value % limit));
    }
  };
  const auto weigh = [&](std::size_t taps) {
    records.insert(records.end(), taps,
                   std::bit_cast<std::uint32_t>(1.0f / static_cast<float>(taps)));
  };
  for (std::size_t i = 0; i < count; ++i) {
    add(lookup.texels, shape.texels());
    add(lookup.views, shape.views);
    add(lookup.lights, shape.lights);
    weigh(lookup.texels);
    weigh(lookup.views);
    weigh(lookup.lights);
  }
  return records;
}

double texel_seconds(const Model& model) {
  const BtfShape& shape = model.info.btf.shape;
  const std::vector<std::uint32_t> records = random_records(shape, host_texels);
  std::vector<double> texel(shape.channels);
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < host_texels; ++i) {
    const std::size_t p = records[3 * i];
    model.decode_texel(records[3 * i + 1], records[3 * i + 2], p / shape.width, p % shape.width,
                       texel);
  }
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return seconds / host_texels;
}

// Products and sums of a texel, where the model counts them.
std::optional<std::size_t> texel_operations(const Model& model) {
  if (const auto* tucker = dynamic_cast<const TuckerModel*>(&model)) {
    return tucker->texel_operations();
  }
  if (const auto* kcta = dynamic_cast<const KctaModel*>(&model)) return kcta->texel_operations();
  if (const auto* train = dynamic_cast<const TtModel*>(&model)) return train->texel_operations();
  return std::nullopt;
}

// Random views and texels; `each` queries of one of them follow each other, and views and texels
// then go on by little, as those of a picture do.
std::vector<LightQuery> light_queries(const BtfShape& shape, std::size_t count, std::size_t each) {
  std::vector<LightQuery> queries(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t slice = i / each;
    const std::uint64_t value = reference::splitmix64(3, each > 1 ? slice / 64 : slice);
    const double theta = static_cast<double>(value & 0xffff) / 65536 * 80;
    const double phi = static_cast<double>(value >> 16 & 0xffff) / 65536 * 360;
    const double step = each > 1 ? 0.05 * static_cast<double>(slice % 64) : 0;
    queries[i].view = direction_from_degrees(theta + step, phi);
    queries[i].texel = static_cast<std::uint32_t>(((value >> 32) + slice % 64) % shape.texels());
  }
  return queries;
}

// Views, texels and lights as they are sampled: records of directions.
std::vector<std::uint32_t> direction_records(const LookupShape& lookup, const BtfShape& shape,
                                             std::size_t count, std::size_t each) {
  std::vector<std::uint32_t> records;
  records.reserve(lookup.words() * count);
  const auto add = [&](float value) { records.push_back(std::bit_cast<std::uint32_t>(value)); };
  const std::vector<LightQuery> queries = light_queries(shape, count, each);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t t = 0; t < lookup.texels; ++t) {
      records.push_back(static_cast<std::uint32_t>((queries[i].texel + t) % shape.texels()));
    }
    const std::uint64_t value = reference::splitmix64(5, i);
    const double theta = static_cast<double>(value & 0xffff) / 65536 * 85;
    const double phi = static_cast<double>(value >> 16 & 0xffff) / 65536 * 360;
    for (const float x : queries[i].view) add(x);
    for (const float x : direction_from_degrees(theta, phi)) add(x);
    for (std::size_t t = 0; t < lookup.weights(); ++t) add(0.25f);
  }
  return records;
}

// Directions drawn per second, of a slice for each and of few slices.
struct DrawRates {
  double single = 0, coherent = 0;
};

// Adds directions drawn, and densities of directions, per second.
DrawRates bench_sampler(LightSampler& sampler, const BtfShape& shape, std::size_t count,
                        Report& report, const std::string& prefix) {
  const auto rate = [](std::size_t queries, const auto& work) {
    work();  // builds kernels and warms the caches
    double least = 0;
    for (std::size_t run = 0; run < runs; ++run) {
      const auto start = std::chrono::steady_clock::now();
      work();
      const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
      least = run == 0 ? time.count() : std::min(least, time.count());
    }
    return static_cast<double>(queries) / least;
  };
  DrawRates rates;
  for (const std::size_t each : {std::size_t{1}, draws_of_slice}) {
    const std::vector<LightQuery> queries =
        light_queries(shape, each > 1 ? 16 * count : count, each);
    std::vector<std::array<float, 2>> numbers;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const std::uint64_t value = reference::splitmix64(4, i);
      numbers.push_back({static_cast<float>(value >> 40) * 0x1p-24f,
                         static_cast<float>(value & 0xffffff) * 0x1p-24f});
    }
    std::vector<DrawnLight> drawn(queries.size());
    const std::string kind = prefix + (each > 1 ? "coherent_" : "");
    double& samples = each > 1 ? rates.coherent : rates.single;
    samples = rate(queries.size(), [&] { sampler.sample(queries, numbers, drawn); });
    report.add(kind + "samples", samples, "/s");
    std::vector<std::array<float, 3>> lights;
    for (const DrawnLight& light : drawn) lights.push_back(light.direction);
    std::vector<float> densities(queries.size());
    report.add(kind + "densities",
               rate(queries.size(), [&] { sampler.densities(queries, lights, densities); }), "/s");
  }
  return rates;
}

void bench_lights(Device& device, const Codec& codec, const Model& model, Report& report) {
  const BtfShape& shape = model.info.btf.shape;
  Report& lights = report.section("lights");
  if (const auto direct = codec.direct_light_sampler(&device, model)) {
    bench_sampler(*direct, shape, direct_light_slices, lights, "direct_");
  }
  bench_sampler(*codec.slice_light_sampler(&device, model), shape, light_slices, lights, "");
  const DrawRates by_slices = bench_sampler(*codec.slice_light_sampler(nullptr, model), shape,
                                            host_light_slices, lights, "reference_");
  // of one core both
  const auto* vq = dynamic_cast<const VqModel*>(&model);
  const auto alone = vq ? reference::vq_light_sampler(*vq, 1) : nullptr;
  if (!alone) return;
  const DrawRates direct =
      bench_sampler(*alone, shape, direct_light_slices, lights, "direct_one_core_");
  lights.add("direct_gain", direct.single / by_slices.single);
  lights.add("coherent_direct_gain", direct.coherent / by_slices.coherent);
}

}  // namespace

void bench_model(Device& device, const ModelBenchOptions& options, Report& report) {
  const std::shared_ptr<const Model> whole = read_model(options.model);
  const ModelSelection selection = make_selection(options.selection, whole->info, options.model);
  const std::shared_ptr<const Model> model = selected_model(whole, selection.part, options.model);
  const Codec& codec = find_codec(model->info.codec);
  const BtfShape& shape = model->info.btf.shape;
  report.add("model", options.model);
  report.add("codec", codec.name());
  report.add("parameters", json_cell(model->info.parameters));
  report.add("selection", selection_cell(selection.whole));
  const auto wanted = [&](std::string_view name) {
    for (std::size_t begin = 0; begin <= options.filter.size();) {
      const std::size_t end = std::min(options.filter.find(',', begin), options.filter.size());
      const auto part = std::string_view(options.filter).substr(begin, end - begin);
      if (name.find(part) != std::string_view::npos) return true;
      begin = end + 1;
    }
    return false;
  };
  if (!wanted("texel") && !wanted("images") && !wanted("look_ups") && !wanted("lights")) {
    fail_input("--filter {}: of a model, texel, images, look_ups and lights are measured",
               options.filter);
  }
  if (wanted("texel")) {
    report.add("texel_time", texel_seconds(*model) * 1e3, "ms");
    if (const auto operations = texel_operations(*model)) {
      report.add("texel_operations", *operations);
    }
  }
  if (wanted("images")) {
    const auto decoder = codec.decoder(device, *model);
    const std::size_t run = image_granule(shape);
    Buffer out(device, run * shape.image_values() * sizeof(float), "decoded images");
    const Times times = measure(device, runs, [&] {
      for (std::size_t first = 0; first < shape.images(); first += run) {
        decoder->decode(first, std::min(run, shape.images() - first), out);
      }
    });
    const double flops = decoder->image_flops() * static_cast<double>(shape.images());
    Report& images = report.section("images");
    images.add("decode_time", times.least, "s");
    images.add("rate", static_cast<double>(shape.images()) / times.least, "images/s");
    images.add("speed", flops / times.least * 1e-9, "GFLOP/s");
    if (options.bound) {
      const ops::Peaks peaks = ops::measure_peaks(device);
      const double bytes = static_cast<double>(shape.values() * sizeof(float));
      const double bound = std::max(flops / peaks.flops, bytes / peaks.bandwidth);
      images.add("of_bound", bound / times.least);
    }
  }
  if (wanted("lights")) bench_lights(device, codec, *model, report);
  if (!wanted("look_ups")) return;
  const auto sampler = codec.sampler(device, *model);
  Report& lookups = report.section("look_ups");
  lookups.add("count", options.lookups);
  Buffer out(device, options.lookups * shape.channels * sizeof(float), "looked up");
  const auto rate = [&](const LookupShape& lookup, const std::vector<std::uint32_t>& records) {
    const std::size_t count = records.size() / lookup.words();
    Buffer in(device, records.size() * sizeof(std::uint32_t), "look-ups");
    device.write(in, std::span<const std::uint32_t>(records));
    const Times times = measure(device, 1, [&] { sampler->look_up(lookup, count, in, out); });
    return static_cast<double>(count) / times.least;
  };
  const std::vector<std::uint32_t> records = random_records(shape, options.lookups);
  constexpr LookupShape single{1, 1, 1}, filtered{4, 3, 3};
  lookups.add("unsorted", rate(single, records), "/s");
  lookups.add("sorted_by_texel", rate(single, sorted_by_texel(records)), "/s");
  const std::size_t fewer = std::max<std::size_t>(options.lookups / 10, 1);
  lookups.add("filtered", rate(filtered, random_filtered(filtered, shape, fewer)), "/s");
  if (!model->takes_directions()) return;
  const auto of_directions = [&](std::size_t texels, std::size_t count, std::size_t each) {
    const LookupShape lookup{texels, 1, 1, true};
    return rate(lookup, direction_records(lookup, shape, count, each));
  };
  lookups.add("directions", of_directions(1, options.lookups, 1), "/s");
  lookups.add("coherent_directions", of_directions(1, options.lookups, draws_of_slice), "/s");
  lookups.add("filtered_directions", of_directions(4, fewer, 1), "/s");
}

}  // namespace weft
