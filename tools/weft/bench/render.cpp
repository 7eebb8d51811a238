// Synthesised materials.
#include <memory>

#include "bench/benchmark.hpp"
#include "weft/btf/directions.hpp"
#include "weft/render/render_surface.hpp"
#include "weft/scene/weave.hpp"

namespace weft {
namespace {

constexpr std::size_t side = 128, lights = 32, samples = 4;
constexpr double hits = static_cast<double>(side * side * samples);

// A piece of cloth seen from one direction.
struct Scene {
  explicit Scene(Device& device)
      : surface(make_surface(standard_cloth(side, side), surface_resolution(side),
                             surface_resolution(side))),
        tables(device, surface),
        records(device, side * side * samples * surface_hit_bytes, "hits") {
    info.dtype = DType::f16;
    info.view_directions = even_directions(2);
    info.light_directions = even_directions(lights);
    info.shape = {info.view_directions.size(), info.light_directions.size(), side, side, 3};
    options.samples = samples;
  }
  void trace(Device& device) {
    launch_surface_hits(device, surface, tables, info, options, 1, band, records);
  }

  Surface surface;
  DeviceSurface tables;
  Buffer records;
  BtfInfo info;
  SurfaceRenderOptions options;
  TexelBand band{0, side, 0, side};
};

Run trace_view_rays(Device& device) {
  const auto scene = std::make_shared<Scene>(device);
  return [=, &device] { scene->trace(device); };
}

Run shade(Device& device) {
  const auto scene = std::make_shared<Scene>(device);
  scene->trace(device);
  const std::size_t count = scene->info.shape.lights;
  const std::vector<float> packed =
      pack_surface_lights(device, scene->surface, scene->info, 0, count);
  const auto directions = std::make_shared<Buffer>(device, packed.size() * sizeof(float), "lights");
  device.write(*directions, std::span<const float>(packed));
  const auto out = std::make_shared<Buffer>(
      device, count * side * side * 3 * size_of(scene->info.dtype), "images");
  return [=, &device] {
    launch_surface_shade(device, scene->surface, scene->tables, scene->info, scene->options, 1,
                         scene->band, scene->records, scene->records, *directions, count, *out);
  };
}

}  // namespace

std::vector<Benchmark> render_benchmarks() {
  const double record = static_cast<double>(surface_hit_bytes);
  return {
      {"surface_hits", "128 x 128 texels, 4 samples", 0, record * hits, false, trace_view_rays},
      {"surface_shade", "128 x 128 texels, 4 samples, 32 lights", 0,
       record * hits + 6.0 * side * side * lights, false, shade},
  };
}

}  // namespace weft
