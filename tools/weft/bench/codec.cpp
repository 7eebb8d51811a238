#include "bench/codec.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <system_error>
#include <vector>

#include "bench/benchmark.hpp"
#include "bench/measure.hpp"
#include "weft/btf/directions.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/render/render_surface.hpp"
#include "weft/scene/weave.hpp"

namespace weft {
namespace {

// A raw BTF to encode: the user's, or one that is made and removed again.
class Input {
 public:
  Input(Device& device, const std::string& file) : path_(file) {
    if (!file.empty()) return;
    made_ = true;
    path_ =
        std::filesystem::temp_directory_path() / fmt::format("weft-bench-{}.safetensors", getpid());
    BtfInfo info;
    info.dtype = DType::f16;
    info.view_directions = even_directions(31);
    info.light_directions = even_directions(31);
    info.shape = {31, 31, 128, 128, 3};
    const std::size_t resolution = surface_resolution(128);
    SurfaceRenderOptions options;
    options.samples = 1;
    const std::unique_ptr<TileSink> sink = create_raw_btf(path_, info);
    render_surface(device, make_surface(standard_cloth(128, 128), resolution, resolution), options,
                   *sink);
  }
  ~Input() {
    std::error_code ignored;
    if (made_) std::filesystem::remove(path_, ignored);
  }
  Input(const Input&) = delete;
  Input& operator=(const Input&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::string name() const { return made_ ? "a synthesised weave" : path_.string(); }

 private:
  std::filesystem::path path_;
  bool made_ = false;
};

// Flops per second of a product as large as those of textbooks.
double product_speed(Device& device) {
  const std::size_t n = 2048;
  const Buffer A = random_buffer(device, n * n, "A");
  const Buffer B = random_buffer(device, n * n, "B");
  Buffer C(device, n * n * sizeof(float), "C");
  const Times times = measure(device, 3, [&] {
    ops::gemm(device, n, n, n, 1, ops::row_major(device, A, n), ops::row_major(device, B, n), 0,
              ops::to_row_major(device, C, n));
  });
  return 2.0 * n * n * n / times.least;
}

// The rank to encode with: the one that was asked for, else the codec's own, or 64 where that
// depends on a goal. Empty if the codec has none, or one for each mode.
std::string rank_of(const Codec& codec, const std::string& asked) {
  const auto specs = codec.parameters();
  const bool by_modes = std::any_of(specs.begin(), specs.end(),
                                    [](const ParameterSpec& spec) { return spec.name == "mode"; });
  if (by_modes && asked.empty()) return {};
  for (const ParameterSpec& parameter : codec.parameters()) {
    if (parameter.name != "rank") continue;
    if (!asked.empty()) return asked;
    return parameter.default_value.empty() ? "64" : std::string(parameter.default_value);
  }
  return {};
}

}  // namespace

std::vector<const Codec*> codecs_matching(const std::string& filter) {
  std::vector<const Codec*> matching;
  for (const Codec* codec : codecs()) {
    const std::string row = fmt::format("codec {}", codec->name());
    if (row.find(filter) != std::string::npos) matching.push_back(codec);
  }
  return matching;
}

void bench_codecs(Device& device, const ops::Peaks& peaks, const CodecBenchOptions& options,
                  Report& report) {
  const std::vector<const Codec*> wanted = codecs_matching(options.filter);
  if (wanted.empty()) return;
  const Input input(device, options.input);
  const std::shared_ptr<TileSource> whole = open_raw_btf(input.path());
  const RecordedSelection selection = make_selection(options.selection, whole->info());
  const std::shared_ptr<TileSource> source = select(whole, selection);
  const double gemm_peak = product_speed(device);

  std::vector<std::vector<Cell>> rows;
  std::vector<std::vector<Cell>> stage_rows;
  const auto bound_of = [&](const Stage& stage) {
    return stage.flops / gemm_peak + stage.bytes / peaks.bandwidth;
  };
  for (const Codec* codec : wanted) {
    Parameters parameters;
    const std::string rank = rank_of(*codec, options.rank);
    if (!rank.empty()) parameters["rank"] = rank;
    for (std::size_t run = 1; run <= 3; ++run) {  // the first one reads the file, builds kernels
      Job job;
      job.memory = options.memory;
      const auto start = std::chrono::steady_clock::now();
      const auto model = codec->encode(device, *source, parameters, Storage::f16, job);
      measure_errors(device, *codec->decoder(device, *model), *source, job);
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
        const double bound = bound_of(stage);
        stage_rows.push_back(
            {text_cell(codec->name()), count_cell(run), text_cell(stage.name),
             number_cell(stage.seconds), number_cell(stage.flops * 1e-9),
             number_cell(stage.bytes * 1e-9), number_cell(bound),
             bound > 0 ? number_cell(stage.seconds / bound) : Cell{"", "null", true}});
      }
      const double bound = flops / gemm_peak + bytes / peaks.bandwidth;
      rows.push_back({text_cell(codec->name()), text_cell(rank.empty() ? "-" : rank),
                      count_cell(run), number_cell(seconds), number_cell(flops * 1e-9),
                      number_cell(bytes * 1e-9), number_cell(bound), number_cell(seconds / bound),
                      number_cell(flops / seconds / gemm_peak),
                      number_cell(bytes / seconds / peaks.bandwidth), text_cell(stages)});
    }
  }
  report.add("gemm_peak", gemm_peak * 1e-9, "GFLOP/s");
  report.add("codec_input", input.name());
  report.add("codec_selection", selection_cell(selection));
  report.table("codecs",
               {"codec", "rank", "run", "seconds", "gflop", "gigabytes", "bound_seconds",
                "times_the_bound", "of_gemm_peak", "of_bandwidth", "stages"},
               std::move(rows));
  report.table("codec_stages",
               {"codec", "run", "stage", "seconds", "gflop", "gigabytes", "bound_seconds",
                "times_the_bound"},
               std::move(stage_rows));
}

}  // namespace weft
