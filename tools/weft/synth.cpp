// weft synth: renders a simulated material into a raw BTF.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "btf_report.hpp"
#include "common.hpp"
#include "progress.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/btf/directions.hpp"
#include "weft/device/device.hpp"
#include "weft/error.hpp"
#include "weft/io/npy.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/job.hpp"
#include "weft/reference/render_surface.hpp"
#include "weft/render/render_surface.hpp"
#include "weft/scene/material.hpp"

namespace weft {
namespace {

// Runs of images larger than this gain nothing.
constexpr std::size_t largest_tile = std::size_t{64} << 20;
// Of the 16 rays through a texel: their mask, squared distances and distances.
constexpr std::size_t mask_work_bytes = 16 * 32;
// Of a sample of one texel, before its lights are added up.
constexpr std::size_t least_texel_bytes = surface_hit_bytes + surface_bounce_bytes;

struct SynthOptions {
  std::string material = "weave";
  std::string size = "128";
  std::string view_set = "ubo81";
  std::string light_set = "ubo81";
  std::size_t samples = 4;
  std::size_t bounces = 0;
  std::string dtype = "f16";
  std::uint64_t seed = 0;
  std::optional<std::uint64_t> material_seed;
  bool list = false;
  std::string print, fields;
  std::string output;
  DeviceOptions device;
  OutputOptions report;
};

// Whether the output is NAME.npy, or else NAME.safetensors.
bool is_npy_output(const std::string& output) {
  const OutputKind kind = output_kind(output);
  if (kind != OutputKind::npy && kind != OutputKind::safetensors) {
    fail_input("--output: '{}' does not end in .safetensors or .npy", output);
  }
  return kind == OutputKind::npy;
}

void list_materials() {
  for (const MaterialPreset& preset : material_presets()) {
    fmt::print("{:12} {}\n", preset.name, find_material(preset.name, "--list").summary);
  }
}

// A table as in docs/materials.md.
void list_fields(const std::string& kind) {
  fmt::print("| field | accepts | default | meaning |\n|---|---|---|---|\n");
  for (const FieldRow& row : material_fields(kind, "--fields")) {
    fmt::print("| `{}` | {} | {} | {} |\n", row.path, row.accepts, row.standard, row.meaning);
  }
}

// Fields that only together are wrong are found here: the message says of which material.
Surface make_named_surface(const Material& material, const ImageSize& size,
                           const std::string& name) {
  try {
    return make_surface(material, size.width, size.height);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::input) throw;
    fail_input("--material: '{}': {}", name, error.what());
  }
}

// What stays in memory besides the images in the making.
MemoryPlan plan_synth(const SynthOptions& options, const SurfaceExtent& extent,
                      const BtfInfo& info) {
  const BtfShape& shape = info.shape;
  MemoryPlan plan;
  plan.limit = options.device.memory;
  plan.add("surface", extent.bytes());
  if (!options.device.reference()) {
    const std::size_t layers = extent.layers, undersides = extent.undersides;
    plan.add("surface on the device",
             extent.cells() * DeviceSurface::cell_bytes(layers, undersides));
    plan.add("surface on its way",
             extent.cells() * DeviceSurface::copied_cell_bytes(layers, undersides));
  }
  if (extent.undersides > 0) {
    // Of all views, as found and as written; and what one view's distances are found by.
    plan.add("masks", 2 * shape.views * shape.texels() * (sizeof(std::uint8_t) + sizeof(float)) +
                          mask_work_bytes * shape.texels());
  }
  return plan;
}

void run_synth(const SynthOptions& options) {
  if (options.list) return list_materials();
  if (!options.print.empty()) {
    fmt::print("{}", find_preset(options.print, "--print").text);
    return;
  }
  if (!options.fields.empty()) return list_fields(options.fields);
  if (options.output.empty()) fail_input("--output is required");
  // Everything that can be wrong with the request is found before any work.
  const ImageSize size = parse_image_size(options.size, "--size");
  const bool npy = is_npy_output(options.output);
  check_can_create(options.output);
  if (npy) check_can_create(std::filesystem::path(options.output).replace_extension(".json"));
  Material material = find_material(options.material, "--material");
  if (options.material_seed) material.set_seed(*options.material_seed);
  BtfInfo info;
  info.dtype = parse_dtype(options.dtype, "--dtype");
  info.encoding = info.dtype == DType::u8 ? Encoding::srgb : Encoding::linear;
  info.quantity = Quantity::radiance;
  info.view_directions = direction_set(options.view_set, "--view-set");
  info.light_directions = direction_set(options.light_set, "--light-set");
  info.shape = {info.view_directions.size(), info.light_directions.size(), size.height, size.width,
                3};
  info.channel_names = {"R", "G", "B"};
  info.source =
      fmt::format("weft synth --material {} --material-seed {} --samples {} --bounces {} --seed {}",
                  material.name, material.seed(), options.samples, options.bounces, options.seed);
  SurfaceRenderOptions render;
  render.samples = options.samples;
  render.seed = options.seed;
  render.bounces = options.bounces;
  MemoryPlan plan = plan_synth(options, surface_extent(material, size.width, size.height), info);
  // At least an image of each in the making has to fit.
  const std::size_t least_tile = std::max(info.image_bytes(), options.samples * least_texel_bytes);
  const std::size_t room = options.device.memory - std::min(options.device.memory, plan.total());
  render.tile_bytes =
      std::clamp<std::size_t>(room / surface_tiles, least_tile, std::max(least_tile, largest_tile));
  plan.add("images in the making", surface_tiles * render.tile_bytes);
  plan.check();

  std::optional<Device> device;
  if (!options.device.reference()) device.emplace(options.device.device, options.device.profile);
  const auto start = std::chrono::steady_clock::now();
  const Surface surface = make_named_surface(material, size, options.material);
  // The file says first what each view meets.
  if (device) {
    render_surface_mask(*device, surface, render, info);
  } else {
    render_surface_mask_reference(surface, render, info);
  }
  const std::unique_ptr<TileSink> sink =
      npy ? create_npy_btf(options.output, info) : create_raw_btf(options.output, info);

  Progress progress(options.report, "synth", info.shape.images());
  render.progress = [&progress](std::size_t done) { progress.update(done); };
  if (device) {
    render_surface(*device, surface, render, *sink);
  } else {
    render_surface_reference(surface, render, *sink);
  }
  progress.finish();
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

  Report report;
  report.add("output", options.output);
  report.add("material", options.material);
  report.add("material_seed", material.seed());
  add_btf_fields(report, info);
  report.add("samples", options.samples, "per texel");
  report.add("bounces", options.bounces);
  report.add("seed", options.seed);
  report.add("device", device ? device->limits().name : std::string("reference"));
  report.add("memory_planned", bytes_cell(plan.total()));
  report.add("file_size", bytes_cell(std::filesystem::file_size(options.output)));
  report.add("time", seconds, "s");
  const double samples = static_cast<double>(info.shape.images()) *
                         static_cast<double>(info.shape.texels()) *
                         static_cast<double>(options.samples);
  report.add("rate", samples / seconds, "samples/s");
  if (device && options.device.profile) add_profile_table(report, device->profile());
  report.print(options.report);
}

}  // namespace

void add_synth(CLI::App& program, Action& action) {
  auto options = std::make_shared<SynthOptions>();
  CLI::App* command = program.add_subcommand("synth", "Render a simulated material into a raw BTF");
  command
      ->add_option("--material", options->material,
                   "A preset of --list, or a file NAME.json in the form of --print")
      ->type_name("NAME|FILE.json");
  command
      ->add_option("--material-seed", options->material_seed,
                   "Seed of the material's irregularities, instead of its file's")
      ->type_name("NUMBER");
  command->add_option("--size", options->size, "Texels of an image; the tile repeats seamlessly")
      ->type_name("N|WIDTHxHEIGHT");
  command
      ->add_option("--view-set", options->view_set,
                   "View directions: ubo81, ubo151, or a count of evenly spread ones")
      ->type_name("SET");
  command->add_option("--light-set", options->light_set, "Light directions, likewise")
      ->type_name("SET");
  command
      ->add_option("--samples", options->samples,
                   "Jittered view rays per texel: more is slower and smoother")
      ->check(CLI::Range(1, 65536))
      ->type_name("COUNT");
  command
      ->add_option(
          "--bounces", options->bounces,
          "1: adds the light that comes by way of one more point of the material, as far as "
          "both reflect it diffusely")
      ->check(CLI::Range(0, 1))
      ->type_name("COUNT");
  command->add_option("--dtype", options->dtype, "u8 (sRGB encoding), or f16 or f32 (linear light)")
      ->check(CLI::IsMember({"u8", "f16", "f32"}))
      ->type_name("TYPE");
  add_seed_option(*command, options->seed, "the jitter");
  command
      ->add_option("-o,--output", options->output,
                   "Raw BTF to write: NAME.safetensors, or NAME.npy with directions in NAME.json")
      ->type_name("FILE");
  command->add_flag("--list", options->list, "List the materials, instead")->group("Materials");
  command
      ->add_option("--print", options->print, "Print a preset as JSON, to copy and edit, instead")
      ->group("Materials")
      ->type_name("NAME");
  command
      ->add_option("--fields", options->fields,
                   "Print what a kind of material may set, with ranges and defaults, instead")
      ->group("Materials")
      ->type_name("KIND");
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "A value is the outgoing radiance under a directional light of unit irradiance on a plane\n"
      "perpendicular to it; the light's cosine and shadows are in it. Equal options give equal\n"
      "files, whatever --memory is.\n"
      "\n"
      "Examples:\n"
      "  weft synth -o cloth.safetensors\n"
      "  weft synth --size 256x128 --view-set ubo151 --light-set ubo151 --dtype u8 -o "
      "c.safetensors\n"
      "  weft synth --size 64 --view-set 1 --light-set 100 --samples 64 --dtype f32 -o "
      "relight.npy\n"
      "  weft synth --list\n"
      "  weft synth --print leather > mine.json && weft synth --material mine.json -o "
      "m.safetensors");
  command->callback([options, &action] { action = [options] { run_synth(*options); }; });
}

}  // namespace weft
