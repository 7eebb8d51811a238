#include "render_options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <span>
#include <string_view>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/image_folder.hpp"
#include "weft/scene/studio_map.hpp"
#include "weft/scene/triangle_mesh.hpp"
#include "weft/scene/vector.hpp"

namespace weft {
namespace {

// White is 1; far from where exposures carry it out of the range of float.
constexpr double brightest_background = 1e6;

// Numbers between commas.
std::vector<double> parse_numbers(std::string_view text, std::string_view option,
                                  std::string_view form) {
  std::vector<double> numbers;
  std::string_view rest = text;
  while (true) {
    double number = 0;
    const char* const end = rest.data() + rest.size();
    const auto [stop, status] = std::from_chars(rest.data(), end, number);
    if (status != std::errc{} || !std::isfinite(number) || (stop != end && *stop != ',')) {
      fail_input("{}: '{}' is not {}", option, text, form);
    }
    numbers.push_back(number);
    if (stop == end) return numbers;
    rest = std::string_view(stop + 1, static_cast<std::size_t>(end - stop - 1));
  }
}

Vector3 parse_vector(std::string_view text, std::string_view option) {
  const std::vector<double> numbers = parse_numbers(text, option, "X,Y,Z");
  if (numbers.size() != 3) fail_input("{}: '{}' is not X,Y,Z", option, text);
  return {numbers[0], numbers[1], numbers[2]};
}

// "3" or "3x5".
Repeat parse_repeat(std::string_view text) {
  constexpr std::string_view form = "N or NxM with numbers from 0.001 to 10000";
  const std::size_t cross = text.find('x');
  const auto number = [&](std::string_view part) {
    const std::vector<double> numbers = parse_numbers(part, "--repeat", form);
    if (numbers.size() != 1 || numbers[0] < 0.001 || numbers[0] > 10000) {
      fail_input("--repeat: '{}' is not {}", text, form);
    }
    return numbers[0];
  };
  if (cross == std::string_view::npos) return {number(text), number(text)};
  return {number(text.substr(0, cross)), number(text.substr(cross + 1))};
}

// Radiance or irradiance: one number for all channels, or three.
std::array<double, 3> colour_of(std::span<const double> numbers, std::string_view text,
                                std::string_view option) {
  for (const double number : numbers) {
    if (number < 0) fail_input("{}: '{}' has a negative value", option, text);
  }
  if (numbers.size() == 1) return {numbers[0], numbers[0], numbers[0]};
  return {numbers[0], numbers[1], numbers[2]};
}

DirectionalLight parse_light(std::string_view text) {
  constexpr std::string_view form = "THETA,PHI, THETA,PHI,E or THETA,PHI,R,G,B";
  const std::vector<double> numbers = parse_numbers(text, "--light", form);
  if (numbers.size() < 2 || numbers.size() == 4 || numbers.size() > 5) {
    fail_input("--light: '{}' is not {}", text, form);
  }
  if (numbers[0] < 0 || numbers[0] > 180) {
    fail_input("--light: '{}' has theta {} outside [0, 180]", text, numbers[0]);
  }
  std::array<double, 3> irradiance{std::numbers::pi, std::numbers::pi, std::numbers::pi};
  if (numbers.size() > 2) {
    irradiance = colour_of(std::span(numbers).subspan(2), text, "--light");
  }
  return light_at_degrees(numbers[0], numbers[1], irradiance);
}

std::shared_ptr<const Shape> make_shape(const RenderOptions& options) {
  const Repeat repeat = parse_repeat(options.repeat);
  if (options.shape == "plane") return make_plane(repeat);
  if (options.shape == "sphere") return make_sphere(repeat);
  if (options.shape == "drape") return make_drape(repeat);
  if (std::filesystem::path(options.shape).extension() != ".obj") {
    fail_input("--shape: '{}' is none of plane, sphere, drape, FILE.obj", options.shape);
  }
  TriangleMesh mesh = read_obj(options.shape, options.up_axis == "z" ? UpAxis::z : UpAxis::y);
  fit_unit_sphere(mesh);
  return make_mesh_shape(mesh, repeat);
}

// Where a shape shows itself best: theta, phi and distance.
std::array<double, 3> usual_view(const std::string& shape) {
  if (shape == "plane") return {48, -90, 4.4};
  if (shape == "drape") return {62, -75, 4};
  return {74, -90, 4};
}

Camera make_camera(const RenderOptions& options) {
  Camera camera;
  if (!options.eye.empty()) {
    camera.eye = parse_vector(options.eye, "--eye");
  } else {
    std::array<double, 3> view = usual_view(options.shape);
    if (!options.turn.empty()) {
      const std::vector<double> turn = parse_numbers(options.turn, "--turn", "THETA,PHI");
      if (turn.size() != 2 || turn[0] < 0 || turn[0] > 180) {
        fail_input("--turn: '{}' is not THETA,PHI with theta in [0, 180]", options.turn);
      }
      view[0] = turn[0];
      view[1] = turn[1];
    }
    if (options.distance > 0) view[2] = options.distance;
    camera = camera_at_degrees(view[0], view[1], view[2]);
  }
  const Vector3 target = parse_vector(options.target, "--target");
  if (options.eye.empty()) camera.eye = sum(camera.eye, target);
  camera.target = target;
  camera.field_of_view = options.field_of_view;
  const ImageSize size = parse_image_size(options.size, "--size");
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

void add_lights(const RenderOptions& options, RenderRequest& request) {
  Scene& scene = request.scene;
  for (const std::string& text : options.lights) {
    scene.lights.push_back(parse_light(text));
    request.lighting += (request.lighting.empty() ? "" : "; ") + text;
  }
  if (!options.environment.empty()) {
    scene.environment.map =
        std::make_shared<EnvironmentMap>(read_environment_map(options.environment));
    request.lighting += (request.lighting.empty() ? "" : "; ") + options.environment;
  }
  if (request.lighting.empty()) {
    // a three-quarter key light, and a studio round it as soft fill
    scene.lights.push_back(light_at_degrees(48, -140, {2.6, 2.6, 2.6}));
    scene.environment.map = std::make_shared<EnvironmentMap>(make_studio_map());
    request.lighting = "key light and studio";
  }
  scene.environment.rotation = options.rotation;
  scene.environment.scale = options.environment_scale;
  scene.environment.samples = options.light_samples;
  scene.environment.sampling = light_sampling_from_name(options.sampling, "--sampling");
}

// Turned about the z axis, counter-clockwise as seen from above.
Vector3 turned(const Vector3& v, double degrees) {
  const double angle = degrees * std::numbers::pi / 180;
  return {std::cos(angle) * v[0] - std::sin(angle) * v[1],
          std::sin(angle) * v[0] + std::cos(angle) * v[1], v[2]};
}

void turn_lights(Scene& scene, double degrees) {
  for (DirectionalLight& light : scene.lights) light.direction = turned(light.direction, degrees);
  scene.environment.rotation += degrees;
}

}  // namespace

RenderRequest make_render_request(const RenderOptions& options) {
  // what the checks of the options let pass
  if (std::isnan(options.distance)) fail_input("--distance: nan is no number");
  if (std::isnan(options.difference)) fail_input("--difference: nan is no number");
  RenderRequest request;
  Scene& scene = request.scene;
  scene.camera = make_camera(options);
  scene.samples = options.samples;
  scene.seed = options.seed;
  scene.show_environment = options.show_environment;
  if (options.exposure != "auto") {
    const std::vector<double> stops =
        parse_numbers(options.exposure, "--exposure", "auto or a number of stops");
    if (stops.size() != 1 || std::abs(stops[0]) > 100) {
      fail_input("--exposure: '{}' is not auto or a number of stops from -100 to 100",
                 options.exposure);
    }
    request.exposure = stops[0];
  }
  request.curve = tone_curve_from_name(options.tone, "--tone");
  request.background = {0.1, 0.1, 0.1};
  if (!options.background.empty()) {
    const std::vector<double> numbers =
        parse_numbers(options.background, "--background", "L or R,G,B");
    if (numbers.size() != 1 && numbers.size() != 3) {
      fail_input("--background: '{}' is not L or R,G,B", options.background);
    }
    request.background = colour_of(numbers, options.background, "--background");
    for (const double channel : request.background) {
      if (channel > brightest_background) {
        fail_input("--background: '{}' has a value above {}", options.background,
                   brightest_background);
      }
    }
  }
  add_lights(options, request);
  scene.shape = make_shape(options);
  request.shape = options.shape;
  Scene lit_by_light = scene;  // tables of the material come with the material
  lit_by_light.environment.sampling = LightSampling::light;
  validate(lit_by_light);
  return request;
}

Scene turntable_frame(const Scene& scene, std::size_t frame, std::size_t frames) {
  // what turns is everything but the shape, the other way
  const double degrees = -360.0 * static_cast<double>(frame) / static_cast<double>(frames);
  Scene turned_scene = scene;
  if (frame == 0) return turned_scene;
  turned_scene.camera.eye = turned(scene.camera.eye, degrees);
  turned_scene.camera.target = turned(scene.camera.target, degrees);
  turned_scene.camera.up = turned(scene.camera.up, degrees);
  turn_lights(turned_scene, degrees);
  return turned_scene;
}

Scene light_sweep_frame(const Scene& scene, std::size_t frame, std::size_t frames) {
  Scene turned_scene = scene;
  if (frame > 0) {
    turn_lights(turned_scene, 360.0 * static_cast<double>(frame) / static_cast<double>(frames));
  }
  return turned_scene;
}

void add_render_options(CLI::App& command, RenderOptions& options) {
  command.add_option("INPUT", options.input, "Raw BTF (.safetensors, .npy) or model (.weft)")
      ->required()
      ->type_name("")
      ->default_str("");
  command
      .add_option("-o,--output", options.output,
                  "Picture to write, NAME.png (as shown) or NAME.exr (linear light); with "
                  "--turntable or --light-sweep the folder of the frames")
      ->required()
      ->type_name("FILE")
      ->default_str("");
  command
      .add_option("--compare", options.compare,
                  "Render this raw BTF (or model) too, with the same samples: PSNR and SSIM of the "
                  "pictures as shown, and NAME-original and NAME-difference.png beside the output")
      ->type_name("RAW")
      ->default_str("");
  command
      .add_option("--difference", options.difference,
                  "Factor on the values of the difference image")
      ->check(CLI::Range(1e-6, 1e6))
      ->type_name("N");

  const auto scene = [&](auto* option) { return option->group("Scene"); };
  scene(command.add_option("--shape", options.shape,
                           "plane, sphere, drape (a cloth thrown over a ball) or FILE.obj with "
                           "texture coordinates; all are fitted to a ball of radius 1"))
      ->type_name("SHAPE");
  scene(command.add_option("--up-axis", options.up_axis, "The axis that is up in FILE.obj"))
      ->check(CLI::IsMember({"y", "z"}))
      ->type_name("AXIS");
  scene(command.add_option("--repeat", options.repeat,
                           "Tiles of the material: along a side of plane and drape, from pole to "
                           "pole of the sphere, per unit of texture coordinates of a mesh"))
      ->type_name("N|NxM");
  scene(command.add_option("--size", options.size, "Pixels of the picture"))
      ->type_name("N|WIDTHxHEIGHT");
  scene(command.add_option("--samples", options.samples, "Rays per pixel"))
      ->check(CLI::Range(1, 65536))
      ->type_name("COUNT");
  add_seed_option(command, options.seed, "the samples of the environment");
  scene(command.get_option("--seed"))->default_str(fmt::format("{}", options.seed));

  const auto camera = [&](auto* option) { return option->group("Camera"); };
  auto* turn = camera(
      command.add_option("--turn", options.turn,
                         "Look from this direction, in degrees; by default as suits the shape"));
  turn->type_name("THETA,PHI")->default_str("");
  auto* distance = camera(command.add_option(
      "--distance", options.distance, "... and from so far away; by default as suits the shape"));
  distance->check(CLI::Range(1e-3, 1e6))->type_name("D")->default_str("");
  camera(command.add_option("--eye", options.eye, "Look from this place instead; z is up"))
      ->excludes(turn)
      ->excludes(distance)
      ->type_name("X,Y,Z")
      ->default_str("");
  camera(command.add_option("--target", options.target, "Look at this place"))->type_name("X,Y,Z");
  camera(command.add_option("--fov", options.field_of_view,
                            "Field of view of the picture's shorter side, degrees"))
      ->check(CLI::Range(0.01, 170.0))
      ->type_name("DEGREES");

  const auto light = [&](auto* option) { return option->group("Light"); };
  light(
      command.add_option("--light", options.lights,
                         "A light from this direction, degrees, with irradiance E or R,G,B on a "
                         "plane perpendicular to it (default pi); may be repeated. Without --light "
                         "and --environment: a key light and a soft studio"))
      ->type_name("THETA,PHI[,E|,R,G,B]")
      ->take_all()
      ->allow_extra_args(false)
      ->default_str("");
  light(command.add_option(
            "--environment", options.environment,
            "Light from all round: a latitude-longitude map of radiance, .hdr or .exr"))
      ->type_name("FILE")
      ->default_str("");
  light(command.add_option("--rotate", options.rotation,
                           "Turn the environment about the z axis, degrees"))
      ->type_name("DEGREES");
  light(command.add_option("--environment-scale", options.environment_scale,
                           "Factor on the environment's radiance"))
      ->check(CLI::NonNegativeNumber)
      ->type_name("X");
  light(command.add_option("--light-samples", options.light_samples,
                           "Samples of the environment for each ray"))
      ->check(CLI::Range(1, 65536))
      ->type_name("COUNT");
  light(command.add_option("--sampling", options.sampling,
                           "What these samples are drawn by: light (where the environment is "
                           "bright), material (where it reflects most) or both (half by each, "
                           "weighed together)"))
      ->type_name("WAY");
  light(command.add_flag("--noise", options.noise,
                         "Render once more with other samples, and report the noise they leave: "
                         "the standard deviation of a pixel relative to the mean"));
  light(command.add_flag("--show-environment", options.show_environment,
                         "Show the environment behind the shape"));

  const auto shown = [&](auto* option) { return option->group("Picture"); };
  shown(command.add_option("--background", options.background,
                           "What is shown behind the shape, linear light after exposure [0.1]"))
      ->type_name("L|R,G,B")
      ->default_str("");
  shown(command.add_option("--exposure", options.exposure,
                           "Stops, of PNG alone; auto brings the brighter parts of the shape near "
                           "white, by the first frame"))
      ->type_name("STOPS|auto");
  shown(command.add_option("--tone", options.tone,
                           "Curve of PNG: linear (clipped at white) or reinhard (highlights keep "
                           "their shape)"))
      ->type_name("CURVE");

  const auto frames = [&](auto* option) { return option->group("Frames"); };
  auto* turntable = frames(command.add_option("--turntable", options.turntable,
                                              "Turn the shape once round in so many frames"));
  turntable->check(CLI::Range(1, 100000))->type_name("FRAMES")->default_str("");
  frames(command.add_option("--light-sweep", options.light_sweep,
                            "Turn the lights once round in so many frames"))
      ->excludes(turntable)
      ->check(CLI::Range(1, 100000))
      ->type_name("FRAMES")
      ->default_str("");
  frames(command.add_option("--format", options.format, "Frames as png or exr"))
      ->check(CLI::IsMember({"png", "exr"}))
      ->type_name("FORMAT");
}

}  // namespace weft
