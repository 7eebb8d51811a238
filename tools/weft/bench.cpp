// weft bench: the machine's peaks, every operation's speed beside them (bench/), and codecs from
// end to end.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "bench/benchmark.hpp"
#include "bench/codec.hpp"
#include "bench/measure.hpp"
#include "bench/model.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/error.hpp"
#include "weft/ops/peak.hpp"

namespace weft {
namespace {

struct BenchOptions {
  CodecBenchOptions codec;
  ModelBenchOptions model;
  std::size_t repeat = 7;
  bool list = false;
  SelectionOptions selection;
  DeviceOptions device;
  OutputOptions report;
};

bool wanted(const BenchOptions& options, const Benchmark& benchmark) {
  return benchmark.operation.find(options.codec.filter) != std::string::npos;
}

// A filter that nothing fits is a slip.
void require_match(const BenchOptions& options) {
  const std::vector<Benchmark> benchmarks = all_benchmarks();
  const bool any =
      std::any_of(benchmarks.begin(), benchmarks.end(),
                  [&](const Benchmark& benchmark) { return wanted(options, benchmark); }) ||
      !codecs_matching(options.codec.filter).empty();
  if (!any) {
    fail_input("--filter {}: no operation and no codec is named so; --list names them",
               options.codec.filter);
  }
}

void list_operations(const BenchOptions& options) {
  std::vector<std::vector<Cell>> rows;
  for (const Benchmark& benchmark : all_benchmarks()) {
    if (!wanted(options, benchmark)) continue;
    rows.push_back({text_cell(benchmark.operation), text_cell(benchmark.shape)});
  }
  Report report;
  report.table("operations", {"operation", "shape"}, std::move(rows));
  report.print(options.report);
}

// A number, or nothing where the amount behind it is not known.
Cell known(double amount, double value) {
  return amount > 0 ? number_cell(value) : Cell{"", "null", true};
}

std::vector<Cell> row_of(const Benchmark& benchmark, const Times& times, const ops::Peaks& peaks) {
  const double peak_flops = benchmark.fp64 ? peaks.double_flops : peaks.flops;
  const double bound = std::max(benchmark.flops / peak_flops, benchmark.bytes / peaks.bandwidth);
  return {text_cell(benchmark.operation),
          text_cell(benchmark.shape),
          number_cell(times.least * 1e3),
          number_cell(times.median * 1e3),
          known(benchmark.flops, benchmark.flops / times.least * 1e-9),
          known(benchmark.flops, benchmark.flops / times.least / peak_flops),
          known(benchmark.bytes, benchmark.bytes / times.least * 1e-9),
          known(benchmark.bytes, benchmark.bytes / times.least / peaks.bandwidth),
          number_cell(bound / times.least)};
}

void run_model(const BenchOptions& options) {
  if (options.device.reference()) {
    fail_input("--device reference: models are measured on a device");
  }
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  Report report;
  report.add("device", device->limits().name);
  ModelBenchOptions model = options.model;
  model.filter = options.codec.filter;
  model.selection = options.selection;
  bench_model(*device, model, report);
  add_device_fields(report, device);
  report.print(options.report);
}

void run_bench(const BenchOptions& options) {
  if (!options.model.model.empty()) return run_model(options);
  require_match(options);
  if (options.list) return list_operations(options);
  if (options.device.reference()) {
    fail_input("--device reference: operations are measured on a device");
  }
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  // A machine changes its speed: peaks are measured before and after, and the higher ones count.
  ops::Peaks peaks = ops::measure_peaks(*device);
  std::vector<std::pair<Benchmark, Times>> measured;
  for (Benchmark& benchmark : all_benchmarks()) {
    if (!wanted(options, benchmark)) continue;
    if (benchmark.fp64 && !device->limits().has_fp64) continue;
    const Times times = measure(*device, options.repeat, benchmark.prepare(*device));
    measured.emplace_back(std::move(benchmark), times);
  }
  const ops::Peaks after = ops::measure_peaks(*device);
  peaks.flops = std::max(peaks.flops, after.flops);
  peaks.double_flops = std::max(peaks.double_flops, after.double_flops);
  peaks.bandwidth = std::max(peaks.bandwidth, after.bandwidth);

  Report report;
  report.add("device", device->limits().name);
  report.add("peak_fma", peaks.flops * 1e-9, "GFLOP/s");
  if (peaks.double_flops > 0) {
    report.add("peak_fma_double", peaks.double_flops * 1e-9, "GFLOP/s");
  }
  report.add("peak_copy", peaks.bandwidth * 1e-9, "GB/s");
  std::vector<std::vector<Cell>> rows;
  for (const auto& [benchmark, times] : measured) rows.push_back(row_of(benchmark, times, peaks));
  report.table("operations",
               {"operation", "shape", "least_ms", "median_ms", "gflops", "of_peak",
                "gigabytes_per_second", "of_bandwidth", "of_bound"},
               std::move(rows));
  bench_codecs(*device, peaks, options.codec, report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void add_bench(CLI::App& program, Action& action) {
  auto options = std::make_shared<BenchOptions>();
  CLI::App* command =
      program.add_subcommand("bench", "Measure a device's peaks, its operations and the codecs");
  command
      ->add_option(
          "--filter", options->codec.filter,
          "Only operations whose name contains this, for example gemm or 'codec pca'; with "
          "--model, of texel, images, look_ups and lights, some of them divided by commas")
      ->type_name("TEXT");
  command
      ->add_option("--input", options->codec.input,
                   "Raw BTF for the codecs' rows; without it, a small weave is synthesised")
      ->type_name("FILE");
  command
      ->add_option("--rank", options->codec.rank,
                   "Rank of the codecs' rows (default: each codec's own)")
      ->type_name("COUNT");
  command
      ->add_option("--model", options->model.model,
                   "Instead: how fast this model is decoded, in bulk and texel by texel")
      ->type_name("FILE.weft");
  command
      ->add_option("--lookups", options->model.lookups, "Random texels of one call, with --model")
      ->check(CLI::Range(1, 100'000'000))
      ->type_name("COUNT");
  command->add_flag(
      "!--no-bound", options->model.bound,
      "With --model, do without the device's peaks and the part of them that is reached");
  command->add_option("--repeat", options->repeat, "Runs of each operation")
      ->check(CLI::Range(1, 1000))
      ->type_name("COUNT");
  command->add_flag("--list", options->list, "Only list the operations");
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "The peaks are measured in the same run: multiply-adds in registers, and a copy far\n"
      "larger than the caches. 'of peak' and 'of bandwidth' are fractions of them; 'of bound' is "
      "the\n"
      "time that an operation's flops and bytes would take at the peaks over the time it took; "
      "tiles\n"
      "that stay in a cache can exceed 1. A codec's bound adds its flops at the speed of a\n"
      "2048 x 2048 x 2048 product and its bytes at the copy's. Selections are of --model or "
      "--input.\n"
      "\n"
      "Examples:\n"
      "  weft bench\n"
      "  weft bench --list\n"
      "  weft bench --filter gemm --json\n"
      "  weft bench --model cloth.weft\n"
      "  weft bench --model cloth.weft --views 'theta<=45' --region center:32x32\n"
      "  weft bench --filter 'codec pca' --input cloth.safetensors --rank 64");
  command->callback([options, &action] {
    options->codec.memory = options->device.memory;
    options->codec.selection = options->selection;
    action = [options] { run_bench(*options); };
  });
}

}  // namespace weft
