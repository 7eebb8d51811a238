#include "weft/reference/render_surface.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <vector>

#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

constexpr std::size_t most_samples = 65536;

Vector3 unit(const Direction& d) {
  return normalized({d[0], d[1], d[2]});
}

// A bilinear look-up: four samples and their weights.
struct Patch {
  std::array<std::size_t, 4> index;
  std::array<double, 4> weight;
};

Patch patch_at(const Surface& surface, double x, double y) {
  const double column = std::floor(x), row = std::floor(y);
  const double fx = x - column, fy = y - row;
  // The sizes are powers of two: masking wraps negative numbers as well.
  const auto wrap = [](double cell, std::size_t size) {
    return static_cast<std::size_t>(static_cast<std::int64_t>(cell)) & (size - 1);
  };
  const std::size_t c0 = wrap(column, surface.columns), c1 = (c0 + 1) & (surface.columns - 1);
  const std::size_t r0 = wrap(row, surface.rows), r1 = (r0 + 1) & (surface.rows - 1);
  const std::size_t low = r0 * surface.columns, high = r1 * surface.columns;
  return {{low + c0, low + c1, high + c0, high + c1},
          {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

double elevation_at(const Surface& surface, double x, double y) {
  const Patch patch = patch_at(surface, x, y);
  double z = 0;
  for (std::size_t i = 0; i < 4; ++i)
    z += patch.weight[i] * surface.layers[0].elevation[patch.index[i]];
  return z;
}

struct Hit {
  double x = 0, y = 0, z = 0;
  double margin = std::numeric_limits<double>::infinity();
};

// The first meeting of a view ray with the surface. (x, y): its point of the reference plane.
Hit trace_view(const Surface& surface, const ViewMarch& march, double x, double y) {
  const auto px = [&](double k) { return x + march.start_x + k * march.step_x; };
  const auto py = [&](double k) { return y + march.start_y + k * march.step_y; };
  const auto above = [&](double k) {
    return march.start_z + k * march.step_z - elevation_at(surface, px(k), py(k));
  };
  Hit hit;
  // March until below the surface. The last point lies at the lowest elevation, so it is.
  double high = 0, above_high = above(0);
  double low = 0, above_low = 0;
  for (std::size_t k = 1; k <= march.steps; ++k) {
    low = static_cast<double>(k);
    above_low = above(low);
    if (k == march.steps) {
      above_low = std::min(above_low, 0.0);
    } else {
      hit.margin = std::min(hit.margin, std::abs(above_low));
    }
    if (above_low <= 0) break;
    high = low;
    above_high = above_low;
  }
  // Halve the step, then take the chord.
  for (int i = 0; i < view_bisections; ++i) {
    const double middle = 0.5 * (high + low);
    const double above_middle = above(middle);
    if (above_middle > 0) {
      high = middle;
      above_high = above_middle;
    } else {
      low = middle;
      above_low = above_middle;
    }
  }
  const double drop = above_high - above_low;
  const double k = drop > 0 ? high + (low - high) * (above_high / drop) : high;
  hit.x = px(k);
  hit.y = py(k);
  hit.z = elevation_at(surface, hit.x, hit.y);
  return hit;
}

// Whether the light reaches a point of the surface.
bool is_lit(const Surface& surface, const LightMarch& march, Hit& hit) {
  const double z0 = hit.z + shadow_bias(surface);
  for (double k = 1;; ++k) {
    const double z = z0 + k * march.step_z;
    if (z >= surface.highest) return true;
    const double above =
        z - elevation_at(surface, hit.x + k * march.step_x, hit.y + k * march.step_y);
    hit.margin = std::min(hit.margin, std::abs(above));
    if (above < 0) return false;
  }
}

std::uint32_t mix(std::uint32_t h) {
  h = (h ^ (h >> 16)) * 0x7feb352du;
  h = (h ^ (h >> 15)) * 0x846ca68bu;
  return h ^ (h >> 16);
}

std::uint32_t low_word(std::uint64_t value) {
  return static_cast<std::uint32_t>(value);
}
std::uint32_t high_word(std::uint64_t value) {
  return static_cast<std::uint32_t>(value >> 32);
}

// What a hit shows; the same for all lights.
struct HitSurface {
  ShadingFrame frame;
  std::array<float, 3> albedo;
  GlossyLobe lobe;
};

HitSurface surface_at(const Surface& surface, const Hit& hit) {
  const Patch patch = patch_at(surface, hit.x, hit.y);
  double nx = 0, ny = 0, fx = 0, fy = 0;
  std::array<double, 3> albedo{};
  for (std::size_t i = 0; i < 4; ++i) {
    const SurfaceSample& sample = surface.layers[0].samples[patch.index[i]];
    const double weight = patch.weight[i];
    nx += weight * sample.normal_x;
    ny += weight * sample.normal_y;
    fx += weight * sample.fibre_x;
    fy += weight * sample.fibre_y;
    const SurfaceColor& color = surface.layers[0].colors[patch.index[i]];
    for (std::size_t c = 0; c < 3; ++c) albedo[c] += weight * color.albedo[c];
  }
  // The lobe is that of the nearest sample.
  const std::size_t nearest =
      (hit.x - std::floor(hit.x) >= 0.5 ? 1u : 0u) + (hit.y - std::floor(hit.y) >= 0.5 ? 2u : 0u);
  const float lobe = surface.layers[0].colors[patch.index[nearest]].lobe;
  const double nz = std::sqrt(std::max(1 - nx * nx - ny * ny, 1e-4));
  // Fibres of crossing yarns may cancel each other between two samples.
  const double length = std::sqrt(std::max(fx * fx + fy * fy, 1e-8));
  return {
      make_frame(normalized({nx, ny, nz}), {fx / length, fy / length, 0}),
      {static_cast<float>(albedo[0]), static_cast<float>(albedo[1]), static_cast<float>(albedo[2])},
      surface.lobes[static_cast<std::size_t>(lobe)]};
}

double srgb_encoded(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

// Stores value i of an image in its dtype.
void store(std::span<std::byte> image, std::size_t i, DType dtype, double value) {
  if (dtype == DType::u8) {
    image[i] = static_cast<std::byte>(std::floor(255 * srgb_encoded(value) + 0.5));
  } else if (dtype == DType::f16) {
    const std::uint16_t bits = float_to_half(static_cast<float>(std::min(value, 65504.0)));
    std::memcpy(&image[2 * i], &bits, sizeof bits);
  } else {
    const auto narrow = static_cast<float>(value);
    std::memcpy(&image[4 * i], &narrow, sizeof narrow);
  }
}

void check_directions(const std::vector<Direction>& directions, const char* field) {
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Direction& d = directions[i];
    if (!(unit(d)[2] >= least_direction_z)) {
      fail_input("surface: {} {} is ({}, {}, {}): its z must be at least {}", field, i, d[0], d[1],
                 d[2], least_direction_z);
    }
  }
}

}  // namespace

ViewMarch march_of_view(const Surface& surface, const Direction& view) {
  const Vector3 v = unit(view);
  const double cells_x = v[0] * static_cast<double>(surface.columns) / surface.width;
  const double cells_y = v[1] * static_cast<double>(surface.rows) / surface.depth;
  const double up = (static_cast<double>(surface.highest) - surface.reference) / v[2];
  const double range = static_cast<double>(surface.highest) - surface.lowest;
  const double length = range / v[2];
  const double cells = std::ceil(length * std::max(std::abs(cells_x), std::abs(cells_y)));
  const double steps = std::max(1.0, cells);
  return {cells_x * up,
          cells_y * up,
          surface.highest,
          -cells_x * length / steps,
          -cells_y * length / steps,
          -range / steps,
          static_cast<std::size_t>(steps)};
}

LightMarch march_of_light(const Surface& surface, const Direction& light) {
  const Vector3 l = unit(light);
  const double cells_x = l[0] * static_cast<double>(surface.columns) / surface.width;
  const double cells_y = l[1] * static_cast<double>(surface.rows) / surface.depth;
  // Under a light at the zenith the first step passes over everything there is.
  const double range = static_cast<double>(surface.highest) - surface.lowest;
  const double length = 1 / std::max({std::abs(cells_x), std::abs(cells_y), 1 / (1 + 2 * range)});
  return {cells_x * length, cells_y * length, l[2] * length};
}

double shadow_bias(const Surface& surface) {
  return 0.25 * std::min(surface.width / static_cast<double>(surface.columns),
                         surface.depth / static_cast<double>(surface.rows));
}

std::uint32_t view_key(std::uint64_t seed, std::size_t view) {
  return mix(low_word(seed) ^
             mix(high_word(seed) ^ mix(low_word(view) ^ mix(high_word(view) ^ 0x9e3779b9u))));
}

std::array<double, 2> sample_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample) {
  // A two-dimensional Kronecker sequence (the plastic number's), shifted by a hash per texel.
  const std::uint32_t key =
      mix(view_key(seed, view) ^ mix(low_word(texel) ^ mix(high_word(texel))));
  const auto s = static_cast<std::uint32_t>(sample);
  const std::uint32_t u = mix(key ^ 0x68bc21ebu) + s * 3242174889u;
  const std::uint32_t v = mix(key ^ 0x02e5be93u) + s * 2447445414u;
  return {(u >> 8) * 0x1p-24, (v >> 8) * 0x1p-24};
}

TracedSample trace_sample(const Surface& surface, const Direction& view, const Direction& light,
                          double x, double y) {
  Hit hit = trace_view(surface, march_of_view(surface, view), x, y);
  const HitSurface shown = surface_at(surface, hit);
  TracedSample sample;
  const Vector3 l = unit(light);
  if (dot(shown.frame.normal, l) > 0 && is_lit(surface, march_of_light(surface, light), hit)) {
    sample.radiance = reflected(shown.frame, shown.albedo, shown.lobe, unit(view), l);
  }
  sample.margin = hit.margin;
  return sample;
}

void validate(const Surface& surface, const BtfInfo& info, const SurfaceRenderOptions& options) {
  validate(surface);
  if (surface.layers.size() != 1 || !surface.layers[0].underside.empty()) {
    fail_input("surface: only one solid layer can be rendered");
  }
  if (info.layout != Layout::grid)
    fail_input("surface: layout is {}, not grid", name_of(info.layout));
  if (info.quantity != Quantity::radiance) {
    fail_input("surface: quantity is {}, not radiance", name_of(info.quantity));
  }
  if (info.shape.channels != 3) {
    fail_input("surface: channels is {}, not 3", info.shape.channels);
  }
  const Encoding encoding = info.dtype == DType::u8 ? Encoding::srgb : Encoding::linear;
  if (info.encoding != encoding) {
    fail_input("surface: {} values are written with encoding {}, not {}", name_of(info.dtype),
               name_of(encoding), name_of(info.encoding));
  }
  if (options.samples < 1 || options.samples > most_samples) {
    fail_input("surface: samples is {}, not from 1 to {}", options.samples, most_samples);
  }
  check_directions(info.view_directions, "view direction");
  check_directions(info.light_directions, "light direction");
}

void render_surface_reference(const Surface& surface, const SurfaceRenderOptions& options,
                              TileSink& sink) {
  const BtfInfo& info = sink.info();
  validate(surface, info, options);
  const BtfShape& shape = info.shape;
  const double columns_per_texel =
      static_cast<double>(surface.columns) / static_cast<double>(shape.width);
  const double rows_per_texel =
      static_cast<double>(surface.rows) / static_cast<double>(shape.height);

  std::vector<std::byte> image(info.image_bytes());
  for (std::size_t index = 0; index < shape.images(); ++index) {
    check_interrupt();
    const std::size_t view = index / shape.lights;
    const Direction& to_view = info.view_directions[view];
    const Direction& to_light = info.light_directions[index % shape.lights];
    for (std::size_t texel = 0; texel < shape.texels(); ++texel) {
      const std::size_t row = texel / shape.width;
      const auto column = static_cast<double>(texel % shape.width);
      // Rows of texels run down, y runs up.
      const auto top = static_cast<double>(shape.height - row);
      Vector3 sum{};
      for (std::size_t s = 0; s < options.samples; ++s) {
        const auto [u, v] = sample_offset(options.seed, view, texel, s);
        const TracedSample sample =
            trace_sample(surface, to_view, to_light, (column + u) * columns_per_texel,
                         (top - v) * rows_per_texel);
        for (std::size_t c = 0; c < 3; ++c) sum[c] += sample.radiance[c];
      }
      for (std::size_t c = 0; c < 3; ++c) {
        store(image, 3 * texel + c, info.dtype, sum[c] / static_cast<double>(options.samples));
      }
    }
    sink.write(index, 1, image);
    if (options.progress) options.progress(index + 1);
  }
  sink.finish();
}

}  // namespace weft
