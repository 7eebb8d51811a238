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

// A red slab over [2, 4) of a period of 8, from z = 0.5 to z = 1, along x or along y; where
// `floor`, with a green solid floor at 0 below it. Its ends taper within half a cell of 1/32.
// Normals of tops are upright.
inline Surface slab(bool along_x, bool floor) {
  constexpr std::size_t n = 256;
  const std::size_t layers = floor ? 2 : 1;
  Surface surface =
      along_x ? make_flat_surface(n, 2, 8, 1, layers) : make_flat_surface(2, n, 1, 8, layers);
  SurfaceLayer& sheet = surface.layers[0];
  sheet.underside.resize(2 * n);
  for (std::size_t i = 0; i < 2 * n; ++i) {
    const std::size_t k = along_x ? i % n : i / 2;
    const bool material = k >= 64 && k < 128;
    sheet.elevation[i] = material ? 1 : 0.5f;
    sheet.underside[i] = material ? 0.5f : 1;
    sheet.colors[i].albedo = {1, 0, 0};
    if (floor) surface.layers[1].colors[i].albedo = {0, 1, 0};
  }
  surface.highest = 1;
  surface.lowest = floor ? 0.0f : 0.5f;
  surface.reference = 1;
  return surface;
}

// A net of round cords that cross in one sheet, with holes between them; below, where `floor`, a
// wavy solid one.
inline Surface net(std::size_t n, bool floor = false) {
  Surface surface = make_flat_surface(n, n, 4, 4, floor ? 2 : 1);
  SurfaceLayer& sheet = surface.layers[0];
  sheet.underside.resize(n * n);
  const double pi = 3.14159265358979323846;
  // Elevation over the middle of a cord of radius 0.35 at a distance from it; beyond it falls on.
  const auto section = [](double distance) {
    const double inside = 0.35 * 0.35 - distance * distance;
    return inside > 0 ? std::sqrt(inside) : 2 * (0.35 - distance);
  };
  for (std::size_t i = 0; i < n * n; ++i) {
    const double x = 4 * static_cast<double>(i % n) / static_cast<double>(n);
    const double y = 4 * static_cast<double>(i / n) / static_cast<double>(n);
    const double lift = 0.2 * std::sin(0.5 * pi * x) * std::cos(0.5 * pi * y);
    const double dx = std::abs(x - 2 * std::round(x / 2)), dy = std::abs(y - 2 * std::round(y / 2));
    const double half = std::max({section(dx), section(dy), -0.3});
    sheet.elevation[i] = static_cast<float>(lift + half);
    sheet.underside[i] = static_cast<float>(lift - half);
    sheet.colors[i].albedo = {0.8f, static_cast<float>(0.2 + 0.2 * x), 0.3f};
    if (floor) {
      surface.layers[1].elevation[i] = static_cast<float>(-1 + 0.2 * std::cos(pi * (x + y)));
      surface.layers[1].colors[i].albedo = {0.1f, 0.6f, static_cast<float>(0.2 * y)};
    }
  }
  surface.lobes = {{{0.05f, 0.1f, 0.2f}, 1, 0.4f, 0.5f}};
  finish_surface(surface);
  return surface;
}

// Grooves whose walls stand at 45 degrees, along y: ridges at x = 0, valleys at x = 1, albedo a.
inline Surface grooves(std::size_t columns, float albedo) {
  Surface surface = make_flat_surface(columns, 2, 2, 2);
  SurfaceLayer& layer = surface.layers[0];
  for (std::size_t i = 0; i < 2 * columns; ++i) {
    const double x = 2 * static_cast<double>(i % columns) / static_cast<double>(columns);
    layer.elevation[i] = static_cast<float>(std::abs(x - 1));
    layer.colors[i].albedo = {albedo, 0.5f * albedo, 0};
  }
  finish_surface(surface);
  return surface;
}

}  // namespace weft::test
