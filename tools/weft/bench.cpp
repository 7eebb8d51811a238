// weft bench: the machine's peaks, every operation's speed beside them, and a codec from end to
// end.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/error.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/ops/decode_pca.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/gram.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/orthonormalise.hpp"
#include "weft/ops/peak.hpp"
#include "weft/ops/tile.hpp"
#include "weft/reference/random.hpp"
#include "weft/render/weave.hpp"
#include "weft/scene/weave.hpp"

namespace weft {
namespace {

struct BenchOptions {
  std::string filter;
  std::string input;
  std::string rank = "64";
  std::size_t repeat = 7;
  DeviceOptions device;
  OutputOptions report;
};

// One measured row. `run` enqueues the work once; flops and bytes are those of one run.
struct Row {
  std::string name;
  std::string shape;
  double flops = 0;
  double bytes = 0;
  std::function<void()> run;
};

struct Times {
  double least = 0;
  double median = 0;
};

Times measure(Device& device, std::size_t repeat, const std::function<void()>& run) {
  using Clock = std::chrono::steady_clock;
  run();  // builds, and warms the caches
  device.finish();
  std::vector<double> seconds(repeat);
  for (double& value : seconds) {
    const Clock::time_point start = Clock::now();
    run();
    device.finish();
    value = std::chrono::duration<double>(Clock::now() - start).count();
  }
  std::sort(seconds.begin(), seconds.end());
  return {seconds.front(), seconds[repeat / 2]};
}

class Bench {
 public:
  Bench(const BenchOptions& options, Device& device) : options_(options), device_(device) {}

  void run(Report& report) {
    peaks_ = ops::measure_peaks(device_);
    report.add("device", device_.limits().name);
    report.add("peak_fma", peaks_.flops * 1e-9, "GFLOP/s");
    report.add("peak_copy", peaks_.bandwidth * 1e-9, "GB/s");
    products();
    small_bases();
    tiles();
    decoding();
    report.table("operations",
                 {"operation", "shape", "least_ms", "median_ms", "gflops", "gigabytes_per_second",
                  "of_bound"},
                 std::move(rows_));
    codec(report);
  }

 private:
  bool wanted(const std::string& name) const {
    return options_.filter.empty() || name.find(options_.filter) != std::string::npos;
  }

  Buffer random_buffer(std::size_t floats, const char* what) {
    std::vector<float> values(floats);
    reference::fill_random(1, values);
    Buffer buffer(device_, floats * sizeof(float), what);
    device_.write(buffer, std::span<const float>(values));
    return buffer;
  }

  void add(const Row& row) {
    const Times times = measure(device_, options_.repeat, row.run);
    const double bound = std::max(row.flops / peaks_.flops, row.bytes / peaks_.bandwidth);
    rows_.push_back({text_cell(row.name), text_cell(row.shape), number_cell(times.least * 1e3),
                     number_cell(times.median * 1e3), number_cell(row.flops / times.least * 1e-9),
                     number_cell(row.bytes / times.least * 1e-9),
                     number_cell(bound / times.least)});
  }

  void products() {
    if (!wanted("gemm")) return;
    for (const std::size_t n : {std::size_t{512}, std::size_t{2048}}) {
      Buffer A = random_buffer(n * n, "A");
      Buffer B = random_buffer(n * n, "B");
      Buffer C(device_, n * n * sizeof(float), "C");
      const auto size = static_cast<double>(n);
      add({"gemm", fmt::format("{0} x {0} x {0}", n), 2 * size * size * size, 12 * size * size,
           [&] {
             ops::gemm(device_, n, n, n, 1, ops::row_major(device_, A, n),
                       ops::row_major(device_, B, n), 0, ops::to_row_major(device_, C, n));
           }});
    }
    // the two products of a pass of the encoder over one run of images
    const std::size_t texels = 16384, rows = 192, block = 72;
    Buffer tile = random_buffer(ops::round_up(texels, ops::panel_width(device_)) * rows, "tile");
    Buffer Q = random_buffer(ops::packed_elements(device_, texels, block), "Q");
    Buffer W(device_, rows * block * sizeof(float), "W");
    Buffer Y(device_, texels * block * sizeof(float), "Y");
    const double flops = 2.0 * texels * rows * block;
    const double bytes = 4.0 * (texels * (rows + block) + rows * block);
    add({"gemm, W = A^T Q", "192 x 72 x 16384", flops, bytes, [&] {
           ops::gemm_packed(device_, rows, block, texels, 1, ops::panelled(device_, tile, rows), Q,
                            0, ops::to_row_major(device_, W, block));
         }});
    add({"gemm, Y^T += W^T A^T", "72 x 16384 x 192", flops, bytes, [&] {
           ops::gemm_packed(device_, block, texels, rows, 1, ops::transposed(device_, W, block),
                            tile, 1, ops::to_row_major(device_, Y, texels));
         }});
  }

  void small_bases() {
    const std::size_t n = 16384, count = 72;
    if (wanted("gram")) {
      Buffer X = random_buffer(ops::packed_elements(device_, n, count), "X");
      const ops::Columns columns = ops::packed_columns(device_, X, n, count);
      add({"gram (double)", "72 x 72 x 16384", 2.0 * n * count * count, 4.0 * n * count,
           [&] { ops::gram(device_, n, columns, columns); }});
    }
    if (wanted("orthonormalise")) {
      Buffer X = random_buffer(ops::packed_elements(device_, n, count), "X");
      Buffer scratch(device_, X.size(), "scratch");
      add({"orthonormalise", "16384 x 72", 8.0 * n * count * count, 16.0 * n * count,
           [&] { ops::orthonormalise(device_, n, count, X, scratch); }});
    }
  }

  void tiles() {
    const std::size_t images = 64, texels = 16384, channels = 3;
    for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
      const ops::TileShape tile{images, texels, channels, dtype, false};
      const auto values = static_cast<double>(tile.values());
      const auto size = static_cast<double>(size_of(dtype));
      const std::string shape = fmt::format("64 x 16384 x 3 {}", name_of(dtype));
      Buffer raw(device_, tile.values() * size_of(dtype), "raw");
      Buffer mean(device_, tile.rows() * sizeof(float), "mean");
      Buffer panels(device_, ops::panel_elements(device_, tile) * sizeof(float), "panels");
      Buffer decoded(device_, tile.values() * sizeof(float), "decoded");
      for (Buffer* buffer : {&raw, &mean, &panels, &decoded}) {
        device_.fill_zero(*buffer, 0, buffer->size());
      }
      if (wanted("scan_tile")) {
        add({"scan_tile", shape, 6 * values, size * values,
             [&] { ops::scan_tile(device_, tile, raw); }});
      }
      if (wanted("convert_tile")) {
        add({"convert_tile", shape, 2 * values, (size + 4) * values,
             [&] { ops::convert_tile(device_, tile, raw, mean, 0, 1.0f, panels); }});
      }
      if (wanted("error_sums")) {
        add({"error_sums", shape, 7 * values, (size + 4) * values,
             [&] { ops::error_sums(device_, tile, raw, decoded, 1.0f); }});
      }
      if (wanted("transcode_tile")) {
        add({"transcode_tile", shape, values, (size + 4) * values, [&] {
               ops::transcode_tile(device_, tile.values(), decoded, Encoding::linear,
                                   Encoding::linear, dtype, raw);
             }});
        add({"transcode_tile to sRGB", shape, values, (size + 4) * values, [&] {
               ops::transcode_tile(device_, tile.values(), decoded, Encoding::linear,
                                   Encoding::srgb, dtype, raw);
             }});
      }
    }
  }

  void decoding() {
    if (!wanted("decode_pca")) return;
    for (const std::size_t rank : {std::size_t{16}, std::size_t{64}}) {
      const ops::DecodePcaShape shape{0, 64, 16384, 3, rank};
      Buffer A = random_buffer(ops::packed_elements(device_, rank, shape.texels), "A");
      Buffer B = random_buffer(shape.images * shape.channels * rank, "B");
      Buffer mean = random_buffer(shape.images * shape.channels, "mean");
      const auto values = static_cast<double>(shape.images * shape.texels * shape.channels);
      Buffer out(device_, shape.images * shape.texels * shape.channels * sizeof(float), "out");
      add({"decode_pca", fmt::format("64 x 16384 x 3, rank {}", rank),
           2 * values * static_cast<double>(rank), 4 * values,
           [&] { ops::decode_pca(device_, shape, A, B, mean, out); }});
    }
  }

  // The codec on a raw BTF: what its flops and bytes cost at the measured peaks, and what it took.
  void codec(Report& report) {
    if (!wanted("pca")) return;
    std::string input = options_.input;
    std::filesystem::path made;
    if (input.empty()) {
      made = std::filesystem::temp_directory_path() /
             fmt::format("weft-bench-{}.safetensors", getpid());
      input = made.string();
      synthesise(input);
    }
    struct Remove {
      const std::filesystem::path& path;
      ~Remove() {
        std::error_code ignored;
        if (!path.empty()) std::filesystem::remove(path, ignored);
      }
    } const remove{made};
    // The machine's measured GEMM peak: a product as large as those of textbooks.
    const std::size_t n = 2048;
    double gemm_peak = 0;
    {
      Buffer A = random_buffer(n * n, "A");
      Buffer B = random_buffer(n * n, "B");
      Buffer C(device_, n * n * sizeof(float), "C");
      gemm_peak = 2.0 * n * n * n / measure(device_, 3, [&] {
                                      ops::gemm(device_, n, n, n, 1, ops::row_major(device_, A, n),
                                                ops::row_major(device_, B, n), 0,
                                                ops::to_row_major(device_, C, n));
                                    }).least;
    }

    const std::shared_ptr<TileSource> source = open_raw_btf(input);
    const Codec& pca = find_codec("pca");
    std::vector<std::vector<Cell>> rows;
    for (std::size_t i = 0; i < 3; ++i) {  // the first run reads the file and builds kernels
      Job job;
      job.memory = options_.device.memory;
      const auto start = std::chrono::steady_clock::now();
      const auto model = pca.encode(device_, *source, {{"rank", options_.rank}}, Storage::f16, job);
      measure_errors(device_, *pca.decoder(device_, *model), *source, job);
      const double seconds =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      double flops = 0;
      double bytes = 0;
      std::string stages;
      for (const Stage& stage : job.stages) {
        flops += stage.flops;
        bytes += stage.bytes;
        stages +=
            fmt::format("{}{} {:.2f} s", stages.empty() ? "" : ", ", stage.name, stage.seconds);
      }
      const double bound = flops / gemm_peak + bytes / peaks_.bandwidth;
      rows.push_back({count_cell(i + 1), number_cell(seconds), number_cell(flops * 1e-9),
                      number_cell(bytes * 1e-9), number_cell(bound), number_cell(seconds / bound),
                      number_cell(flops / seconds / gemm_peak),
                      number_cell(bytes / seconds / peaks_.bandwidth), text_cell(stages)});
    }
    report.add("gemm_peak", gemm_peak * 1e-9, "GFLOP/s");
    report.add("pca_input", options_.input.empty() ? "a synthesised weave" : options_.input);
    report.table("pca_rank_" + options_.rank,
                 {"run", "seconds", "gflop", "gigabytes", "bound_seconds", "times_the_bound",
                  "of_gemm_peak", "of_bandwidth", "stages"},
                 std::move(rows));
  }

  void synthesise(const std::string& path) {
    BtfInfo info;
    info.dtype = DType::f16;
    info.view_directions = even_directions(31);
    info.light_directions = even_directions(31);
    info.shape = {31, 31, 128, 128, 3};
    const std::size_t resolution = surface_resolution(128);
    WeaveRenderOptions options;
    options.samples = 1;
    const std::unique_ptr<TileSink> sink = create_raw_btf(path, info);
    render_weave(device_, make_surface(standard_cloth(128, 128), resolution, resolution), options,
                 *sink);
  }

  const BenchOptions& options_;
  Device& device_;
  ops::Peaks peaks_;
  std::vector<std::vector<Cell>> rows_;
};

void run_bench(const BenchOptions& options) {
  if (options.device.reference()) {
    fail_input("--device reference: operations are measured on a device");
  }
  const std::unique_ptr<Device> device = open_device(options.device);
  Report report;
  Bench(options, *device).run(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void add_bench(CLI::App& program, Action& action) {
  auto options = std::make_shared<BenchOptions>();
  CLI::App* command =
      program.add_subcommand("bench", "Measure a device's peaks, its operations and a codec");
  command
      ->add_option("--filter", options->filter,
                   "Only operations whose name contains this, for example gemm or pca")
      ->type_name("TEXT");
  command
      ->add_option("--input", options->input,
                   "Raw BTF for the codec's row; without it, a small weave is synthesised")
      ->type_name("FILE");
  command->add_option("--rank", options->rank, "Rank of the codec's row")->type_name("COUNT");
  command->add_option("--repeat", options->repeat, "Runs of each operation")
      ->check(CLI::Range(1, 1000))
      ->type_name("COUNT");
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "The peaks are measured first, in the same run: multiply-adds in registers, and a copy far\n"
      "larger than the caches. 'of bound' is the time that an operation's flops and bytes would "
      "take\n"
      "at the peaks over the time it took; tiles that stay in a cache can exceed 1. A codec's "
      "bound\n"
      "adds its flops at the speed of a 2048 x 2048 x 2048 product and its bytes at the copy's.\n"
      "\n"
      "Examples:\n"
      "  weft bench\n"
      "  weft bench --filter gemm --json\n"
      "  weft bench --filter pca --input cloth.safetensors --rank 64");
  command->callback([options, &action] { action = [options] { run_bench(*options); }; });
}

}  // namespace weft
