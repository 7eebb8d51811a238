// Surfaces whose pictures are known, and renders in memory.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/device/device.hpp"
#include "weft/reference/render_surface.hpp"
#include "weft/render/render_surface.hpp"
#include "weft/scene/surface.hpp"
#include "weft/scene/weave.hpp"

namespace weft::test {

// A BTF of 3 channels under these directions.
inline BtfInfo render_info(std::size_t width, std::size_t height, std::vector<Direction> views,
                           std::vector<Direction> lights, DType dtype = DType::f32) {
  BtfInfo info = make_info({views.size(), lights.size(), height, width, 3}, dtype);
  info.view_directions = std::move(views);
  info.light_directions = std::move(lights);
  return info;
}

inline SurfaceRenderOptions render_options(std::size_t samples, std::uint64_t seed = 1) {
  SurfaceRenderOptions options;
  options.samples = samples;
  options.seed = seed;
  return options;
}

inline std::vector<double> render_on_device(Device& device, const Surface& surface,
                                            const BtfInfo& info,
                                            const SurfaceRenderOptions& options) {
  MemorySink sink(info);
  render_surface(device, surface, options, sink);
  EXPECT_TRUE(sink.finished());
  return sink.values();
}

inline std::vector<double> render_on_reference(const Surface& surface, const BtfInfo& info,
                                               const SurfaceRenderOptions& options) {
  MemorySink sink(info);
  render_surface_reference(surface, options, sink);
  EXPECT_TRUE(sink.finished());
  return sink.values();
}

// A level Lambertian plane.
inline Surface lambertian_plane(float albedo) {
  Surface surface = make_flat_surface(16, 8, 2, 1);
  for (SurfaceColor& color : surface.layers[0].colors) color.albedo = {albedo, albedo, albedo};
  finish_surface(surface);
  return surface;
}

// Level, with everything else random and smooth enough to be interpolated: normals, fibres, albedos
// and two lobes that meet along lines between samples.
inline Surface tinted_plane(std::uint64_t seed) {
  constexpr std::size_t n = 16;
  Surface surface = make_flat_surface(n, n, 1, 1);
  finish_surface(surface);
  Random random(seed);
  for (std::size_t i = 0; i < n * n; ++i) {
    SurfaceSample& sample = surface.layers[0].samples[i];
    sample.normal_x = static_cast<float>(random.uniform(-0.3, 0.3));
    sample.normal_y = static_cast<float>(random.uniform(-0.3, 0.3));
    const double angle = random.uniform(-0.7, 0.7);
    sample.fibre_x = static_cast<float>(std::cos(angle));
    sample.fibre_y = static_cast<float>(std::sin(angle));
    SurfaceColor& color = surface.layers[0].colors[i];
    for (float& albedo : color.albedo) albedo = static_cast<float>(random.uniform());
  }
  surface.lobes = {{{0.05f, 0.1f, 0.2f}, 1, 0.25f, 0.5f}};
  return surface;
}

// The standard cloth, coarse enough for a simulator.
inline Surface small_cloth(std::size_t resolution = 64) {
  return make_surface(standard_cloth(64, 64), resolution, resolution);
}

// A green floor at 0, and on it a red plateau at 1 over [2, 4) of a period of 8, along x or along
// y. Its walls are one cell of 1/32 wide. The plane of reference is the floor. All normals are
// upright, so that only what is seen and what is lit makes a difference.
inline Surface plateau(bool along_x) {
  constexpr std::size_t n = 256;
  Surface surface = along_x ? make_flat_surface(n, 2, 8, 1) : make_flat_surface(2, n, 1, 8);
  for (std::size_t i = 0; i < 2 * n; ++i) {
    const std::size_t k = along_x ? i % n : i / 2;
    const bool top = k >= 64 && k < 128;
    surface.layers[0].elevation[i] = top ? 1 : 0;
    surface.layers[0].colors[i].albedo = {top ? 1.0f : 0.0f, top ? 0.0f : 1.0f, 0.0f};
  }
  surface.highest = 1;
  return surface;
}

}  // namespace weft::test
