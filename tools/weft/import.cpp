// weft import: captures and raw files into a raw BTF, tile by tile.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "btf_report.hpp"
#include "common.hpp"
#include "progress.hpp"
#include "report.hpp"
#include "selection_options.hpp"
#include "subcommand.hpp"
#include "weft/btf/adapt.hpp"
#include "weft/btf/copy_images.hpp"
#include "weft/btf/selection.hpp"
#include "weft/error.hpp"
#include "weft/io/capture.hpp"
#include "weft/io/direction_file.hpp"
#include "weft/io/merl.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"

namespace weft {
namespace {

constexpr const char* merl_ending = ".binary";
constexpr const char* usual_set = "ubo81";
// How many of the images that are no part of a capture a report names.
constexpr std::size_t ignored_named = 3;

struct ImportOptions {
  std::vector<std::string> inputs;
  std::string output;
  std::string kind = "auto";
  std::string view_set;  // of MERL BRDFs; usual_set if empty
  std::string light_set;
  std::string manifest;
  std::string lights_file;
  std::string layout;
  std::string encoding;
  std::string quantity;
  std::string dtype;
  SelectionOptions selection;
  OutputOptions common;
};

// The MERL BRDFs that are meant: the files themselves, or those of a folder by their names.
std::vector<std::filesystem::path> merl_files(const ImportOptions& options) {
  std::vector<std::filesystem::path> files;
  std::error_code ignored;
  for (const std::string& input : options.inputs) {
    if (!std::filesystem::is_directory(input, ignored)) {
      files.emplace_back(input);
      continue;
    }
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(input)) {
      if (entry.path().extension() == merl_ending) found.push_back(entry.path());
    }
    if (found.empty()) fail_input("{}: no files named *.binary", input);
    std::sort(found.begin(), found.end());
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

Capture open_input(const ImportOptions& options) {
  const std::string& input = options.inputs.front();
  const std::filesystem::path path(input);
  std::error_code ignored;
  for (const std::string& each : options.inputs) {
    if (!std::filesystem::exists(each, ignored)) fail_input("{}: does not exist", each);
  }
  if (options.kind == "merl" || (options.kind == "auto" && path.extension() == merl_ending)) {
    const auto set = [](const std::string& text, DirectionRole role, const char* option) {
      return read_direction_set(text.empty() ? usual_set : text, role, option);
    };
    return {
        open_merl(merl_files(options), set(options.view_set, DirectionRole::views, "--view-set"),
                  set(options.light_set, DirectionRole::lights, "--light-set")),
        "merl",
        {}};
  }
  if (!options.view_set.empty() || !options.light_set.empty()) {
    fail_input(
        "{}: --view-set and --light-set are for MERL BRDFs; 'weft resample' has them for "
        "raw BTFs",
        input);
  }
  if (options.inputs.size() > 1) {
    fail_input("{} and {}: several inputs are for MERL BRDFs", input, options.inputs[1]);
  }
  // One file with all values in it.
  const bool is_npy = path.extension() == ".npy";
  const bool is_raw = path.extension() == ".safetensors";
  const bool is_file = (is_npy || is_raw) && !std::filesystem::is_directory(path, ignored);
  if (options.kind == "npy" || options.kind == "raw" || (options.kind == "auto" && is_file)) {
    if (!options.manifest.empty() || !options.lights_file.empty() || !options.layout.empty()) {
      fail_input("{}: --manifest, --lights-file and --layout are for images", input);
    }
    if (options.kind == "npy" || (options.kind == "auto" && is_npy)) {
      return {open_npy_btf(path), "npy", {}};
    }
    return {open_raw_btf(path), "raw", {}};
  }
  // Images.
  CaptureOptions capture;
  capture.kind = options.kind;
  capture.manifest = options.manifest;
  capture.lights_file = options.lights_file;
  if (!options.layout.empty()) capture.layout = layout_from_name(options.layout, "--layout");
  return open_capture(path, capture);
}

void run_import(const ImportOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const OutputKind output_kind_found = output_kind(options.output);
  if (output_kind_found != OutputKind::safetensors && output_kind_found != OutputKind::npy) {
    fail_input("{}: a raw BTF ends in .safetensors or .npy", options.output);
  }
  std::optional<DType> dtype;
  if (!options.dtype.empty()) dtype = parse_dtype(options.dtype, "--dtype");
  // Open, relabel, select, convert: in this order, since averaging needs the right encoding.
  const Capture capture = open_input(options);
  std::optional<Encoding> encoding;
  if (!options.encoding.empty()) encoding = encoding_from_name(options.encoding, "--encoding");
  std::optional<Quantity> quantity;
  if (!options.quantity.empty()) quantity = quantity_from_name(options.quantity, "--quantity");
  const std::shared_ptr<TileSource> labelled = relabelled(capture.source, encoding, quantity);
  const RecordedSelection selection = make_selection(options.selection, labelled->info());
  std::shared_ptr<TileSource> source = select(labelled, selection);
  if (dtype) source = converted(source, *dtype);
  BtfInfo info = source->info();
  info.source = selected_source(info.source, selection);
  // Copy.
  const std::unique_ptr<TileSink> sink = output_kind_found == OutputKind::npy
                                             ? create_npy_btf(options.output, info)
                                             : create_raw_btf(options.output, info);
  Progress progress(options.common, "import", info.shape.images());
  copy_images(*source, *sink, [&progress](std::size_t done) { progress.update(done); });
  progress.finish();
  // Report.
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  Report report;
  report.add("input", fmt::format("{}", fmt::join(options.inputs, ", ")))
      .add("kind", capture.kind)
      .add("output", options.output);
  add_btf_fields(report, info);
  report.add("selection", selection_cell(selection));
  report.add("raw_size", bytes_cell(info.bytes()));
  report.add("ignored_images", capture.ignored.size());
  if (!capture.ignored.empty()) {
    const std::size_t named = std::min(ignored_named, capture.ignored.size());
    const std::vector<std::string> names(
        capture.ignored.begin(), capture.ignored.begin() + static_cast<std::ptrdiff_t>(named));
    report.add("ignored", fmt::format("{}{}", fmt::join(names, ", "),
                                      named < capture.ignored.size() ? ", ..." : ""));
  }
  report.add("seconds", seconds, "s");
  report.add("images_per_second", static_cast<double>(info.shape.images()) / seconds);
  report.print(options.common);
}

}  // namespace

void add_import(CLI::App& program, Action& action) {
  auto options = std::make_shared<ImportOptions>();
  CLI::App* command = program.add_subcommand(
      "import", "Turn captures, image folders, NPY and MERL BRDFs into a raw BTF");
  command
      ->add_option("INPUT", options->inputs,
                   "A folder or .zip of images, a manifest (.json, .csv), .npy or .safetensors; or "
                   "one or more MERL BRDFs (.binary), which become a row of texels")
      ->required()
      ->type_name("")
      ->default_str("");
  command->add_option("-o,--output", options->output, "Raw BTF: NAME.safetensors or NAME.npy")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--kind", options->kind,
                   "auto, ubo2003 (directions in the names), manifest, lights (fixed view), flash "
                   "(camera_pos.txt, light_pos.txt), npy, raw or merl (files or a folder of them)")
      ->type_name("KIND")
      ->check(CLI::IsMember(std::vector<std::string>{"auto", "ubo2003", "manifest", "lights",
                                                     "flash", "npy", "raw", "merl"}));
  command->add_option("--manifest", options->manifest, "Manifest that lies elsewhere")
      ->type_name("FILE")
      ->default_str("");
  command
      ->add_option("--lights-file", options->lights_file,
                   "Unit vectors of the lights, line k for image k in natural order, that lie "
                   "elsewhere")
      ->type_name("FILE")
      ->default_str("");
  command
      ->add_option("--layout", options->layout,
                   "grid (every view with every light) or paired, for manifests that do not say it")
      ->type_name("LAYOUT")
      ->default_str("");
  command
      ->add_option("--view-set", options->view_set,
                   "Views at which MERL BRDFs are taken: ubo81, ubo151, a count, "
                   "grid:THETASxPHIS:MAX, or a .json, .npy or raw .safetensors with directions")
      ->type_name("SET")
      ->default_str(usual_set);
  command->add_option("--light-set", options->light_set, "Their lights, likewise")
      ->type_name("SET")
      ->default_str(usual_set);
  command
      ->add_option("--encoding", options->encoding,
                   "What the values are: linear, srgb or gamma2.2; without it gamma2.2 for 8-bit "
                   "ubo2003, srgb for other 8-bit images, linear for EXR")
      ->type_name("NAME")
      ->default_str("");
  command
      ->add_option("--quantity", options->quantity,
                   "What the values are: radiance (the light's cosine in it) or brdf")
      ->type_name("NAME")
      ->default_str("");
  command->add_option("--dtype", options->dtype, "Store as u8, f16 or f32; without it as read")
      ->type_name("TYPE")
      ->default_str("");
  add_selection_options(*command, options->selection);
  add_output_options(*command, options->common);
  command->footer(
      "A folder's kind follows from what lies in it: manifest.json or manifest.csv, "
      "camera_pos.txt\n"
      "with light_pos.txt, lights.txt, or names such as '00008 tl000 pl000 tv030 pv030.jpg'.\n"
      "\n"
      "CSV manifests have a header line: file, then view_theta,view_phi (degrees) or\n"
      "view_x,view_y,view_z or view (a line of views.txt, from 0) or nothing for a fixed view, "
      "and\n"
      "the same with light. JSON: {\"images\": [{\"file\": \"a.png\", \"view\": [0, 0], "
      "\"light\": [30, 90]}]},\n"
      "with two numbers for theta and phi in degrees and three for a unit vector.\n"
      "\n"
      "Examples:\n"
      "  weft import UBO_CORDUROY256.zip -o corduroy.safetensors --level 1\n"
      "  weft import photometric/cat --lights-file photometric/lights.txt -o cat.safetensors\n"
      "  weft import cards_flash -o cards.safetensors --region 256,256,256x256\n"
      "  weft import paint.binary brass.binary --light-set 400 -o two.safetensors\n"
      "  weft import knit.npy -o knit.safetensors --views 0,4-8 --dtype f16\n"
      "  weft import cloth.safetensors -o part.safetensors --views 'theta<=60' --region "
      "center:64x64");
  command->callback([options, &action] { action = [options] { run_import(*options); }; });
}

}  // namespace weft
