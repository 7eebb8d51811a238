// weft render: pictures of a material on a shape, from a raw BTF or a model.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "btf_report.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "render_options.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/io/atomic_folder.hpp"
#include "weft/io/picture_file.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/metrics/ssim.hpp"
#include "weft/model/model_file.hpp"
#include "weft/render/shade.hpp"
#include "weft/scene/light_tables.hpp"
#include "weft/scene/ray_caster.hpp"
#include "weft/scene/render_picture.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// What is rendered: one of the two.
struct Material {
  std::shared_ptr<TileSource> raw;
  std::shared_ptr<const Model> model;
};

Material open_material(const std::string& file, const SelectionOptions& selection) {
  Material material;
  if (ModelFile::looks_like(file)) {
    const std::shared_ptr<const Model> model = read_model(file);
    material.model = selected_model(model, make_selection(selection, model->info, file).part, file);
    validate_material(material.model->info.btf);
  } else {
    const std::shared_ptr<TileSource> raw = open_raw_btf(file);
    material.raw = select(raw, make_selection(selection, raw->info()));
    validate_material(material.raw->info());
  }
  return material;
}

// How opacities are found from a model of the mask, or from a raw BTF's signed distances where that
// is asked for; none where they are the interpolated mask.
std::optional<VisibilityMapping> opacity_mapping(const Material& material,
                                                 const RenderOptions& options) {
  const Occlusion* const occlusion =
      material.model ? material.model->info.occlusion.get() : nullptr;
  const bool has_distances = material.raw && !material.raw->info().mask_distance.empty();
  if (!occlusion && !has_distances) {
    if (options.mapping.any()) {
      fail_input("--occlusion-{}: '{}' has neither a model of a mask nor signed distances",
                 options.mapping.threshold ? "threshold" : "weight", options.input);
    }
    return std::nullopt;
  }
  if (!occlusion && !options.mapping.any()) return std::nullopt;
  return make_mapping(options.mapping,
                      occlusion ? occlusion->mapping : default_mapping(OcclusionKind::distance));
}

// Of what is compared: as of the input, where both have signed distances.
std::optional<VisibilityMapping> compared_mapping(const Material& input, const Material& compared,
                                                  std::optional<VisibilityMapping> mapping) {
  const Occlusion* const of_input = input.model ? input.model->info.occlusion.get() : nullptr;
  if (compared.raw && of_input && of_input->kind == OcclusionKind::mask) return std::nullopt;
  return mapping;
}

std::unique_ptr<Shader> make_shader(const Material& material, Device* device,
                                    std::optional<VisibilityMapping> mapping, Job& job) {
  return material.raw ? make_shader(device, material.raw, job, mapping)
                      : make_shader(device, material.model, job, mapping);
}

// Makes the tables that lights are drawn from, where they are. Of two materials that are compared,
// both are seen in the same light.
void draw_lights_by(Shader& material, Scene& scene, Job& job) {
  EnvironmentLight& environment = scene.environment;
  if (!environment.map || environment.sampling == LightSampling::light) return;
  environment.material =
      std::make_shared<const LightTables>(material.light_tables(job.memory / 8, job));
  job.held.push_back({"tables to draw lights from", environment.material->bytes()});
}

Picture render(const Scene& scene, Shader& material, Job& job) {
  return render_picture(RayCaster(scene), material, job);
}

bool is_picture_name(const fs::path& path) {
  return path.extension() == ".png" || path.extension() == ".exr";
}

// Where the output and what goes beside it will be.
struct Outputs {
  fs::path picture;
  fs::path original, difference;  // with --compare
};

// Checks the names before the work: their endings, and that files can be made there.
Outputs plan_outputs(const RenderOptions& options) {
  Outputs outputs{options.output, {}, {}};
  picture_format(outputs.picture, "--output");
  const fs::path folder = fs::absolute(outputs.picture).parent_path();
  if (!fs::is_directory(folder)) {
    fail_input("--output: '{}': there is no folder '{}'", options.output, folder.string());
  }
  if (!options.compare.empty()) {
    const auto beside = [&](const char* what, const fs::path& extension) {
      fs::path path = outputs.picture;
      path.replace_extension();
      path += std::string("-") + what + extension.string();
      return path;
    };
    outputs.original = beside("original", outputs.picture.extension());
    outputs.difference = beside("difference", ".png");
  }
  for (const fs::path& path : {outputs.picture, outputs.original, outputs.difference}) {
    if (path.empty()) continue;
    if (fs::is_directory(path)) fail_input("--output: '{}' is a folder", path.string());
    check_can_create(path);
  }
  return outputs;
}

// Stops that bring the brighter parts of the material near white: the 95th percentile of the
// largest channel, of pixels that show nothing else, becomes 0.8.
double chosen_exposure(const Picture& picture) {
  std::vector<float> brightest;
  for (const std::array<float, 4>& pixel : picture.pixels) {
    const float value = std::max({pixel[0], pixel[1], pixel[2]});
    if (pixel[3] > 0.999f && value > 0 && std::isfinite(value)) brightest.push_back(value);
  }
  if (brightest.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(brightest.size() - 1));
  std::nth_element(brightest.begin(), brightest.begin() + rank, brightest.end());
  return std::log2(0.8 / static_cast<double>(brightest[static_cast<std::size_t>(rank)]));
}

// The standard deviation of the luminance of a pixel that shows nothing but material, which the
// samples of the environment leave, from two pictures of other samples: root mean square over them,
// relative to their mean.
double relative_noise(const Picture& one, const Picture& other) {
  double squares = 0, sum = 0, count = 0;
  for (std::size_t i = 0; i < one.pixels.size(); ++i) {
    if (one.pixels[i][3] <= 0.999f) continue;
    const auto luminance = [i](const Picture& picture) {
      const std::array<float, 4>& pixel = picture.pixels[i];
      return slice_luminance(std::array{double{pixel[0]}, double{pixel[1]}, double{pixel[2]}});
    };
    const double a = luminance(one), b = luminance(other);
    squares += (a - b) * (a - b) / 2;
    sum += (a + b) / 2;
    count += 1;
  }
  return sum > 0 ? std::sqrt(squares * count) / sum : 0;
}

// How pictures are finished: the exposure is chosen by the first.
class Finish {
 public:
  explicit Finish(const RenderRequest& request) : request_(request) {}

  // Puts the background behind a picture of light alone.
  void apply(Picture& picture) {
    if (!exposure_) exposure_ = request_.exposure ? request_.exposure : chosen_exposure(picture);
    if (request_.scene.show_environment) return;
    // shown as it was asked for, once exposed
    const double factor = std::exp2(-*exposure_);
    for (std::array<float, 4>& pixel : picture.pixels) {
      for (std::size_t c = 0; c < 3; ++c) {
        // of a float, so that where nothing of it is seen nothing is added
        const double behind =
            std::min<double>(factor * request_.background[c], std::numeric_limits<float>::max());
        pixel[c] += (1 - pixel[3]) * static_cast<float>(behind);
      }
    }
  }
  ToneMapping tone() const { return {exposure_.value_or(0), request_.curve}; }

 private:
  const RenderRequest& request_;
  std::optional<double> exposure_;
};

void render_frames(const RenderOptions& options, const Scene& scene, Shader& material,
                   Finish& finish, AtomicFolder& folder, Job& job) {
  const bool turns = options.turntable > 0;
  const std::size_t frames = turns ? options.turntable : options.light_sweep;
  // one progress for all frames
  const auto progress = job.progress;
  const std::string stage = fmt::format("render {} {}:", frames, frames == 1 ? "frame" : "frames");
  std::size_t frames_done = 0;
  job.progress = [&](const std::string&, std::size_t done, std::size_t total) {
    progress(stage, frames_done * total + done, frames * total);
  };
  for (std::size_t frame = 0; frame < frames; ++frame) {
    check_interrupt();
    Picture picture = render(
        turns ? turntable_frame(scene, frame, frames) : light_sweep_frame(scene, frame, frames),
        material, job);
    finish.apply(picture);
    const StageTimer timer(job, "write");
    write_picture(folder.temporary() / fmt::format("frame-{:05}.{}", frame, options.format),
                  picture, finish.tone());
    ++frames_done;
  }
  job.progress = progress;
  folder.commit();
}

void run_render(const RenderOptions& options) {
  // Everything that can be wrong with the request is found before any work.
  const std::size_t frames = std::max(options.turntable, options.light_sweep);
  if (frames > 0 && !options.compare.empty()) {
    fail_input("--compare takes one picture, not the frames of --turntable or --light-sweep");
  }
  if (frames > 0 && options.noise) {
    fail_input("--noise takes one picture, not the frames of --turntable or --light-sweep");
  }
  Outputs outputs;
  if (frames == 0) {
    outputs = plan_outputs(options);
  } else if (is_picture_name(options.output)) {
    fail_input("--output: '{}' is a picture's name; --turntable and --light-sweep fill a folder",
               options.output);
  }
  const RenderRequest request = make_render_request(options);
  Scene scene = request.scene;
  if (!options.compare.empty()) check_ssim(scene.camera.height, scene.camera.width, 1.0);
  const Material input = open_material(options.input, options.selection);
  Material compared;
  if (!options.compare.empty()) compared = open_material(options.compare, {});
  const std::optional<VisibilityMapping> mapping = opacity_mapping(input, options);
  std::optional<AtomicFolder> folder;
  if (frames > 0) folder.emplace(options.output, false);
  std::unique_ptr<Device> device = open_device(options.device, options.report);
  ReportedJob reported(options.device, options.report, "pixels");
  Job& job = reported.job();
  const std::size_t pixels = scene.camera.width * scene.camera.height;
  // another picture, the display values of two, and the bytes of a file
  job.held.push_back({"pictures", pixels * (4 * sizeof(float) + 3 * (3 * sizeof(double) + 2))});
  if (scene.environment.map) {
    job.held.push_back({"environment map", scene.environment.map->bytes()});
  }
  if (const std::size_t bytes = scene.shape->bytes(); bytes > 0) {
    job.held.push_back({"mesh", bytes});
  }
  const Clock::time_point start = Clock::now();
  std::unique_ptr<Shader> material = make_shader(input, device.get(), mapping, job);
  draw_lights_by(*material, scene, job);

  Finish finish(request);
  PictureComparison comparison;
  double seconds_per_frame = 0, noise = 0;
  const Clock::time_point first_frame = Clock::now();
  if (frames > 0) {
    render_frames(options, scene, *material, finish, *folder, job);
    seconds_per_frame = seconds_since(first_frame) / static_cast<double>(frames);
  } else {
    Picture picture = render(scene, *material, job);
    seconds_per_frame = seconds_since(first_frame);
    if (options.noise) {
      Scene again = scene;
      again.seed = scene.seed + 1;
      noise = relative_noise(picture, render(again, *material, job));
    }
    finish.apply(picture);
    if (!options.compare.empty()) {
      material.reset();  // two may not fit
      const auto shader =
          make_shader(compared, device.get(), compared_mapping(input, compared, mapping), job);
      Picture original = render(scene, *shader, job);
      finish.apply(original);
      const StageTimer timer(job, "compare");
      comparison = compare_pictures(picture, original, finish.tone());
      write_picture(outputs.original, original, finish.tone());
      write_display_values(outputs.difference, picture.width, picture.height,
                           difference_values(picture, original, finish.tone(), options.difference));
    }
    const StageTimer timer(job, "write");
    write_picture(outputs.picture, picture, finish.tone());
  }
  reported.finish_progress();

  Report report;
  report.add("input", options.input);
  report.add("output", options.output);
  if (frames > 0) report.add("frames", frames);
  report.add("shape", request.shape);
  report.add("lighting", request.lighting);
  report.add("width", scene.camera.width, "pixels");
  report.add("height", scene.camera.height, "pixels");
  report.add("samples", scene.samples, "per pixel");
  report.add("lights", scene.lights_per_point(), "per sample");
  if (scene.environment.map) report.add("sampling", options.sampling);
  if (options.noise) report.add("noise", noise);
  report.add("exposure", finish.tone().exposure, "stops");
  if (mapping) {
    report.add("occlusion_threshold", mapping->threshold);
    report.add("occlusion_weight", mapping->weight);
  }
  if (!options.compare.empty()) {
    report.add("compared_with", options.compare);
    report.add("original", outputs.original.string());
    report.add("difference", outputs.difference.string());
    report.add("difference_scale", options.difference);
    add_error_fields(report.section("errors_as_shown"), comparison.display);
    add_error_fields(report.section("errors_of_light"), comparison.linear);
  }
  report.add("device", device_name(device));
  report.add("time", seconds_since(start), "s");
  report.add("frame_time", seconds_per_frame, "s");
  report.add("frames_per_second", 1 / seconds_per_frame);
  reported.add_fields(report);
  add_device_fields(report, device);
  report.print(options.report);
}

}  // namespace

void add_render(CLI::App& program, Action& action) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* command = program.add_subcommand(
      "render", "Render a material on a plane, a sphere, a draped cloth or a mesh");
  add_render_options(*command, *options);
  add_mapping_options(*command, options->mapping);
  add_selection_options(*command, options->selection);
  add_device_options(*command, options->device);
  add_output_options(*command, options->report);
  command->footer(
      "The world has z up; theta is measured from +z and phi from +x towards +y, the camera looks\n"
      "from -y unless it is turned. A material's value is radiance per unit of irradiance on a "
      "plane\n"
      "perpendicular to the light: a white matt surface facing a light of irradiance pi is shown "
      "as\n"
      "white at exposure 0. Pictures appear whole or not at all. The options of the selection "
      "choose\n"
      "what of the material is used: directions between those that are left are interpolated, "
      "those\n"
      "beyond take the nearest; --compare is taken whole.\n"
      "\n"
      "Examples:\n"
      "  weft render cloth.weft -o ball.png\n"
      "  weft render cloth.weft --shape drape --environment venice.hdr --show-environment -o "
      "d.png\n"
      "  weft render cloth.weft --environment venice.hdr --sampling both --noise -o ball.exr\n"
      "  weft render cloth.weft --compare cloth.safetensors --light 45,-135 -o ball.png\n"
      "  weft render cloth.safetensors --views 'theta<=60' --compare cloth.safetensors -o rim.png\n"
      "  weft render cloth.safetensors --shape plane --light 60,0,3 --light 30,180,0,0,1 -o p.exr\n"
      "  weft render cloth.weft --shape chair.obj --repeat 8 --turntable 120 -o frames/");
  command->callback([options, &action] { action = [options] { run_render(*options); }; });
}

}  // namespace weft
