// weft resample: a raw BTF in other directions, or one texel of it as a MERL BRDF.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "btf_report.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "weft/btf/copy_images.hpp"
#include "weft/btf/encoding.hpp"
#include "weft/btf/hemisphere.hpp"
#include "weft/btf/onion_slices.hpp"
#include "weft/btf/radial_basis.hpp"
#include "weft/btf/resampling.hpp"
#include "weft/codecs/resampled_source.hpp"
#include "weft/error.hpp"
#include "weft/io/direction_file.hpp"
#include "weft/io/merl.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

constexpr const char* merl_ending = ".binary";
// Far above any set of directions of one texel that can be measured.
constexpr std::size_t most_brdf_values = std::size_t{1} << 26;

struct ResampleOptions {
  std::string input;
  std::string output;
  std::string view_set;
  std::string light_set;
  std::string onion;
  std::string dtype;
  std::string nan = "error";
  SelectionOptions selection;
  DeviceOptions device;
  OutputOptions report;
};

bool is_merl_output(const ResampleOptions& options) {
  return std::filesystem::path(options.output).extension() == merl_ending;
}

// Everything that can be wrong with the options alone.
void check_options(const ResampleOptions& options) {
  const bool sets = !options.view_set.empty() || !options.light_set.empty();
  if (is_merl_output(options)) {
    if (sets || !options.onion.empty() || !options.dtype.empty()) {
      fail_input(
          "{}: a MERL BRDF has directions and a type of its own: no --view-set, --light-set, "
          "--onion or --dtype",
          options.output);
    }
  } else {
    const OutputKind kind = output_kind(options.output);
    if (kind != OutputKind::safetensors && kind != OutputKind::npy) {
      fail_input("{}: a raw BTF ends in .safetensors or .npy, a MERL BRDF in .binary",
                 options.output);
    }
    if (sets && !options.onion.empty()) {
      fail_input("--onion: onion slices are views and lights: no --view-set and --light-set");
    }
    if (!sets && options.onion.empty()) {
      fail_input("new directions are needed: --view-set, --light-set, both, or --onion");
    }
  }
  check_can_create(options.output);
}

Resampling make_resampling(const ResampleOptions& options, const BtfInfo& info) {
  if (!options.onion.empty()) return resample_to(info, parse_onion_sizes(options.onion, "--onion"));
  const auto set = [](const std::string& text, DirectionRole role, const char* option,
                      const std::vector<Direction>& measured) {
    return text.empty() ? measured : read_direction_set(text, role, option);
  };
  return resample_to(
      info, set(options.view_set, DirectionRole::views, "--view-set", info.view_directions),
      set(options.light_set, DirectionRole::lights, "--light-set", info.light_directions));
}

// f(view, light) of the one texel, interpolated in triangles of directions, in linear light and
// without the light's cosine.
class TexelBrdf {
 public:
  TexelBrdf(TileSource& texel, bool nan_zero)
      : info_(texel.info()),
        views_(info_.view_directions),
        lights_(info_.light_directions),
        values_(info_.shape.values()) {
    reference::read_tile(texel, 0, info_.shape.images(), nan_zero, values_);
  }

  std::array<double, 3> operator()(const DirectionPair& pair) const {
    const DirectionWeights v = views_.at(pair.view), l = lights_.at(pair.light);
    const bool has_cosine = info_.quantity == Quantity::radiance;
    std::array<double, 3> colour{};
    for (std::size_t c = 0; c < 3; ++c) {
      double stored = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          const std::size_t image = v.index[i] * info_.shape.lights + l.index[k];
          stored += v.weight[i] * l.weight[k] * values_[image * 3 + c];
        }
      }
      const double linear = decode_to_linear(info_.encoding, stored);
      colour[c] = std::max(has_cosine ? linear * l.scale / pair.light[2] : linear, 0.0);
    }
    return colour;
  }

 private:
  const BtfInfo& info_;
  Hemisphere views_, lights_;
  std::vector<double> values_;
};

void write_brdf(const ResampleOptions& options, TileSource& source) {
  const BtfInfo& info = source.info();
  const BtfShape& shape = info.shape;
  if (shape.texels() != 1 || shape.channels != 3 || info.layout != Layout::grid) {
    fail_input(
        "{}: a MERL BRDF is of one texel in three channels and every view with every light, "
        "not of {} x {} texels in {} channels, layout {}: --region X,Y,1x1 chooses a texel",
        options.input, shape.width, shape.height, shape.channels, name_of(info.layout));
  }
  if (shape.values() > most_brdf_values) {
    fail_input("{}: {} views and {} lights are more than {} values", options.input, shape.views,
               shape.lights, most_brdf_values);
  }
  require_above_horizon(info.view_directions, "view");
  require_above_horizon(info.light_directions, "light");
  const TexelBrdf brdf(source, options.nan == "zero");
  write_merl(options.output, brdf);
}

std::unique_ptr<TileSink> create_sink(const ResampleOptions& options, const BtfInfo& info) {
  if (output_kind(options.output) == OutputKind::npy) return create_npy_btf(options.output, info);
  return create_raw_btf(options.output, info);
}

void run_resample(const ResampleOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  check_options(options);
  std::optional<DType> dtype;
  if (!options.dtype.empty()) dtype = parse_dtype(options.dtype, "--dtype");
  const std::shared_ptr<TileSource> input = open_raw_btf(options.input);
  const RecordedSelection selection = make_selection(options.selection, input->info());
  const bool nan_zero = options.nan == "zero";
  const std::shared_ptr<TileSource> source = selected_part(input, selection, nan_zero);
  Report report;
  report.add("input", options.input).add("output", options.output);
  report.add("selection", selection_cell(selection));
  if (is_merl_output(options)) {
    write_brdf(options, *source);
    report.add("kind", "merl");
    report.add("file_size", bytes_cell(std::filesystem::file_size(options.output)));
    report.add("time", std::chrono::duration<double>(Clock::now() - start).count(), "s");
    return report.print(options.report);
  }
  Resampling resampling = make_resampling(options, source->info());
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  ReportedJob reported(options.device, options.report, "texels");
  Job& job = reported.job();
  job.nan_zero = nan_zero;
  job.held.push_back({"images out", 2 * copy_images_bytes(resampling.info)});
  const std::size_t masks = mask_bytes(source->info(), resampling);
  if (masks > 0) job.held.push_back({"masks", 2 * masks});
  ResampledSource resampled(device.get(), *source, std::move(resampling), job);
  resampled.take_masks();
  BtfInfo info = resampled.info();
  info.dtype = dtype.value_or(source->info().dtype);
  info.source = selected_source(info.source, selection);
  info.source += fmt::format("{}resampled to {}", info.source.empty() ? "" : "; ",
                             options.onion.empty() ? "other directions" : "onion slices");
  const std::unique_ptr<TileSink> sink = create_sink(options, info);
  copy_images(resampled, *sink, [](std::size_t) {});
  reported.finish_progress();
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  add_btf_fields(report, info);
  report.add("raw_size", bytes_cell(info.bytes()));
  report.add("device", device_name(device));
  report.add("passes", resampled.passes());
  report.add("time", seconds, "s");
  report.add("texel_rate", static_cast<double>(info.shape.texels()) / seconds, "texels/s");
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void add_resample(CLI::App& program, Action& action) {
  auto options = std::make_shared<ResampleOptions>();
  CLI::App* command =
      program.add_subcommand("resample", "Interpolate a raw BTF in other directions");
  command->add_option("INPUT", options->input, "Raw BTF: .safetensors or .npy")
      ->required()
      ->type_name("");
  command
      ->add_option(
          "-o,--output", options->output,
          "Raw BTF: NAME.safetensors or NAME.npy; or a MERL BRDF of one texel: NAME.binary")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--view-set", options->view_set,
                   "New views: ubo81, ubo151, a count of evenly spread ones, grid:THETASxPHIS:MAX, "
                   "or a .json, .npy or raw .safetensors with directions; without it as measured")
      ->type_name("SET")
      ->default_str("");
  command->add_option("--light-set", options->light_set, "New lights, likewise")
      ->type_name("SET")
      ->default_str("");
  command
      ->add_option("--onion", options->onion,
                   "Pairs of views and lights in onion slices instead, of these sizes n_alpha, "
                   "n_beta, n_theta, n_phi, as 11,11,7,16")
      ->type_name("SIZES")
      ->default_str("");
  command->add_option("--dtype", options->dtype, "Store as u8, f16 or f32; without it as read")
      ->check(CLI::IsMember({"u8", "f16", "f32"}))
      ->type_name("TYPE")
      ->default_str("");
  command
      ->add_option("--nan", options->nan,
                   "NaN and infinite values in the input: error, or zero to read them as 0")
      ->check(CLI::IsMember({"error", "zero"}))
      ->type_name("CHOICE");
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "Between measured directions lie radial basis functions (the biharmonic spline), one matrix\n"
      "for the lights and one for the views: measured directions keep their values, and what "
      "would\n"
      "fall below 0 is 0. Directions outside the measured ones are clamped to them; radiance then\n"
      "falls with the light's cosine. A mask is that of the nearest measured view.\n"
      "\n"
      "Examples:\n"
      "  weft resample cloth.safetensors --view-set 40 --light-set ubo81 -o small.safetensors\n"
      "  weft resample cloth.safetensors --light-set lights.json -o relit.safetensors\n"
      "  weft resample cloth.safetensors --view-set grid:6x24:75 -o rings.npy\n"
      "  weft resample cloth.safetensors --onion 11,11,7,16 --memory 8GiB -o slices.safetensors\n"
      "  weft resample paint.safetensors --region 0,0,1x1 -o paint.binary");
  command->callback([options, &action] { action = [options] { run_resample(*options); }; });
}

}  // namespace weft
