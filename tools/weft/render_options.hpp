// The options of weft render, and the scene they describe.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common.hpp"
#include "occlusion_options.hpp"
#include "selection_options.hpp"
#include "weft/scene/picture.hpp"
#include "weft/scene/scene.hpp"

namespace CLI {
class App;
}

namespace weft {

struct RenderOptions {
  std::string input;
  std::string output;
  std::string compare;
  double difference = 4;  // factor on the difference image

  std::string shape = "sphere";
  std::string up_axis = "y";
  std::string repeat = "3";

  std::string eye, turn;
  double distance = 0;  // 0: by the shape
  double field_of_view = 35;
  std::string target = "0,0,0";
  std::string size = "512";

  std::vector<std::string> lights;
  std::string environment;
  double rotation = 0;
  double environment_scale = 1;
  std::size_t light_samples = 16;
  std::string sampling = "light";
  bool noise = false;
  bool show_environment = false;
  std::string background;
  std::size_t samples = 4;
  std::uint64_t seed = 1;

  std::string exposure = "auto";
  std::string tone = "linear";

  std::size_t turntable = 0, light_sweep = 0;  // frames; 0: one picture
  std::string format = "png";                  // of frames

  MappingOptions mapping;
  SelectionOptions selection;  // of the material
  DeviceOptions device;
  OutputOptions report;
};

void add_render_options(CLI::App& command, RenderOptions& options);

// Everything that the options say, checked, files of shape and light read. Throws an input error
// that names the option and the value.
struct RenderRequest {
  Scene scene;
  std::array<double, 3> background{};  // linear light, as shown after exposure
  std::optional<double> exposure;      // stops; none: by the picture
  ToneCurve curve = ToneCurve::linear;
  std::string shape, lighting;  // for the report
};
RenderRequest make_render_request(const RenderOptions& options);

// Frame `frame` of a turntable (the shape turns counter-clockwise as seen from above, camera and
// lights stay) or of a light sweep (lights and environment turn, shape and camera stay).
Scene turntable_frame(const Scene& scene, std::size_t frame, std::size_t frames);
Scene light_sweep_frame(const Scene& scene, std::size_t frame, std::size_t frames);

}  // namespace weft
