#include "weft/reference/render_surface.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <span>
#include <vector>

#include "weft/btf/mask_distance.hpp"
#include "weft/error.hpp"
#include "weft/tensor/half.hpp"

namespace weft {
namespace {

constexpr std::size_t most_samples = 65536;

Vector3 unit(const Direction& d) {
  return normalized({d[0], d[1], d[2]});
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

// The texel's own part of the hash.
std::uint32_t texel_key(std::uint64_t seed, std::size_t view, std::size_t texel) {
  return mix(view_key(seed, view) ^ mix(low_word(texel) ^ mix(high_word(texel))));
}

// The `sample`-th member of a Kronecker sequence that a key shifts.
double sequence(std::uint32_t key, std::size_t sample, std::uint32_t step) {
  return ((mix(key) + static_cast<std::uint32_t>(sample) * step) >> 8) * 0x1p-24;
}

// What a hit shows; the same for all lights.
struct HitSurface {
  ShadingFrame frame;
  std::array<float, 3> albedo;
  GlossyLobe lobe;
};

// Unit normal of an underside, which points down: from its central differences, interpolated.
Vector3 underside_normal(const Surface& surface, const std::vector<float>& z, double x, double y) {
  const double per_x = 0.5 * static_cast<double>(surface.columns) / surface.width;
  const double per_y = 0.5 * static_cast<double>(surface.rows) / surface.depth;
  return normalized({per_x * (height_at(surface, z, x + 1, y) - height_at(surface, z, x - 1, y)),
                     per_y * (height_at(surface, z, x, y + 1) - height_at(surface, z, x, y - 1)),
                     -1});
}

HitSurface surface_at(const Surface& surface, const SurfaceHit& hit) {
  const SurfaceLayer& layer = surface.layers[hit.layer];
  const SurfacePatch patch = patch_at(surface, hit.x, hit.y);
  double nx = 0, ny = 0, fx = 0, fy = 0;
  std::array<double, 3> albedo{};
  for (std::size_t i = 0; i < 4; ++i) {
    const SurfaceSample& sample = layer.samples[patch.index[i]];
    const double weight = patch.weight[i];
    nx += weight * sample.normal_x;
    ny += weight * sample.normal_y;
    fx += weight * sample.fibre_x;
    fy += weight * sample.fibre_y;
    const SurfaceColor& color = layer.colors[patch.index[i]];
    for (std::size_t c = 0; c < 3; ++c) albedo[c] += weight * color.albedo[c];
  }
  // The lobe is that of the nearest sample.
  const std::size_t nearest =
      (hit.x - std::floor(hit.x) >= 0.5 ? 1u : 0u) + (hit.y - std::floor(hit.y) >= 0.5 ? 2u : 0u);
  const float lobe = layer.colors[patch.index[nearest]].lobe;
  const Vector3 normal =
      hit.under ? underside_normal(surface, layer.underside, hit.x, hit.y)
                : normalized({nx, ny, std::sqrt(std::max(1 - nx * nx - ny * ny, 1e-4))});
  // Fibres of crossing yarns may cancel each other between two samples.
  const double length = std::sqrt(std::max(fx * fx + fy * fy, 1e-8));
  return {
      make_frame(normal, {fx / length, fy / length, 0}),
      {static_cast<float>(albedo[0]), static_cast<float>(albedo[1]), static_cast<float>(albedo[2])},
      surface.lobes[static_cast<std::size_t>(lobe)]};
}

// The direction with density cos/pi round a normal that a point of the unit square stands for, in
// the frame of Duff et al., "Building an orthonormal basis, revisited" (2017).
Vector3 cosine_direction(const Vector3& n, const std::array<double, 2>& square) {
  const double sign = n[2] >= 0 ? 1 : -1;
  const double a = -1 / (sign + n[2]), b = n[0] * n[1] * a;
  const double angle = 2 * std::numbers::pi * square[1];
  const double p = std::sqrt(square[0]) * std::cos(angle);
  const double q = std::sqrt(square[0]) * std::sin(angle);
  const double r = std::sqrt(1 - square[0]);
  return {p * (1 + sign * n[0] * n[0] * a) + q * b + r * n[0],
          p * sign * b + q * (sign + n[1] * n[1] * a) + r * n[1],
          -p * sign * n[0] - q * n[1] + r * n[2]};
}

// What comes to a hit by way of one more point, and is reflected diffusely at both.
Vector3 bounced(const Surface& surface, const SurfaceHit& hit, const HitSurface& shown,
                const Vector3& light, const std::array<double, 2>& square, double& margin) {
  const Vector3 away = cosine_direction(shown.frame.normal, square);
  const SurfaceHit second = trace_from(surface, hit, away, margin);
  if (!second.met) return {};
  const HitSurface there = surface_at(surface, second);
  if (dot(there.frame.normal, away) >= 0) return {};
  const double cosine = dot(there.frame.normal, light);
  if (cosine <= 0 || !is_lit(surface, march_along(surface, light), second, margin)) return {};
  Vector3 radiance;
  for (std::size_t c = 0; c < 3; ++c) {
    radiance[c] = shown.albedo[c] * there.albedo[c] * std::numbers::inv_pi * cosine;
  }
  return radiance;
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

std::uint32_t view_key(std::uint64_t seed, std::size_t view) {
  return mix(low_word(seed) ^
             mix(high_word(seed) ^ mix(low_word(view) ^ mix(high_word(view) ^ 0x9e3779b9u))));
}

std::array<double, 2> sample_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample) {
  // A two-dimensional Kronecker sequence (the plastic number's), shifted by a hash per texel.
  const std::uint32_t key = texel_key(seed, view, texel);
  return {sequence(key ^ 0x68bc21ebu, sample, 3242174889u),
          sequence(key ^ 0x02e5be93u, sample, 2447445414u)};
}

std::array<double, 2> bounce_offset(std::uint64_t seed, std::size_t view, std::size_t texel,
                                    std::size_t sample) {
  // Two more dimensions, with the powers of the root of x^5 = x + 1.
  const std::uint32_t key = texel_key(seed, view, texel);
  return {sequence(key ^ 0x5851f42du, sample, 2700274807u),
          sequence(key ^ 0x14057b7eu, sample, 2313257605u)};
}

TracedSample trace_sample(const Surface& surface, const Direction& view, const Direction& light,
                          double x, double y, const std::optional<std::array<double, 2>>& bounce) {
  TracedSample sample;
  const SurfaceHit hit = trace_view(surface, march_of_view(surface, view), x, y, sample.margin);
  if (!hit.met) return sample;
  sample.met = true;
  const HitSurface shown = surface_at(surface, hit);
  const Vector3 l = unit(light);
  if (dot(shown.frame.normal, l) > 0 &&
      is_lit(surface, march_along(surface, l), hit, sample.margin)) {
    sample.radiance = reflected(shown.frame, shown.albedo, shown.lobe, unit(view), l);
  }
  if (bounce) {
    const Vector3 more = bounced(surface, hit, shown, l, *bounce, sample.margin);
    for (std::size_t c = 0; c < 3; ++c) sample.radiance[c] += more[c];
  }
  return sample;
}

void validate(const Surface& surface, const BtfInfo& info, const SurfaceRenderOptions& options) {
  validate(surface);
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
  if (options.bounces > 1) fail_input("surface: bounces is {}, not 0 or 1", options.bounces);
  check_directions(info.view_directions, "view direction");
  check_directions(info.light_directions, "light direction");
}

void render_surface_mask_reference(const Surface& surface, const SurfaceRenderOptions& options,
                                   BtfInfo& info) {
  validate(surface, info, options);
  info.mask.clear();
  info.mask_distance.clear();
  if (!may_have_holes(surface)) return;
  const std::size_t width = mask_parts * info.shape.width;
  const std::size_t height = mask_parts * info.shape.height;
  const double columns_per_part = static_cast<double>(surface.columns) / static_cast<double>(width);
  const double rows_per_part = static_cast<double>(surface.rows) / static_cast<double>(height);
  std::vector<std::uint8_t> fine(width * height);
  for (std::size_t view = 0; view < info.shape.views; ++view) {
    check_interrupt();
    const ViewMarch march = march_of_view(surface, info.view_directions[view]);
    for (std::size_t part = 0; part < fine.size(); ++part) {
      const auto [u, v] = sample_offset(options.seed, view, part, 0);
      const std::size_t row = part / width;
      const auto column = static_cast<double>(part % width);
      const auto top = static_cast<double>(height - row);
      double margin = widest_margin;
      const SurfaceHit hit = trace_view(surface, march, (column + u) * columns_per_part,
                                        (top - v) * rows_per_part, margin);
      fine[part] = hit.met ? 1 : 0;
    }
    add_view_mask(fine, mask_parts, info);
  }
  normalize_distances(info.mask_distance);
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
        std::optional<std::array<double, 2>> bounce;
        if (options.bounces > 0) bounce = bounce_offset(options.seed, view, texel, s);
        const TracedSample sample =
            trace_sample(surface, to_view, to_light, (column + u) * columns_per_texel,
                         (top - v) * rows_per_texel, bounce);
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
