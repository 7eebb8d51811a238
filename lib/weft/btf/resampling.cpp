#include "weft/btf/resampling.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "weft/btf/encoding.hpp"
#include "weft/btf/radial_basis.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

using Vector = RadialBasis::Vector;

// Views within this of the zenith (radians) have no azimuth.
constexpr double zenith_angle = 1e-5;

Vector unit(const Direction& d) {
  const Vector v{d[0], d[1], d[2]};
  const double length = std::hypot(v[0], v[1], v[2]);
  return {v[0] / length, v[1] / length, v[2] / length};
}

// What both kinds of grid share.
Resampling begin(const BtfInfo& measured) {
  if (measured.layout == Layout::paired) {
    fail_input(
        "the input holds {} pairs of a view and a light (layout paired): every view with every "
        "light is needed to interpolate between directions",
        measured.shape.views);
  }
  Resampling resampling;
  resampling.info = measured;
  resampling.info.dtype = DType::f32;
  resampling.info.mask.clear();
  resampling.info.mask_distance.clear();
  resampling.measured_views = measured.shape.views;
  resampling.measured_lights = measured.shape.lights;
  resampling.largest = measured.dtype == DType::u8 ? 1 : 0;
  return resampling;
}

// One row of A.
void add_light(const RadialBasis& basis, const BtfInfo& measured, const Vector& light,
               std::vector<double>& rows) {
  const std::size_t at = rows.size();
  rows.resize(at + basis.size());
  const std::span<double> row = std::span(rows).subspan(at);
  const double scale = basis.weigh(light, row);
  if (measured.quantity != Quantity::radiance) return;
  const double factor = encode_from_linear(measured.encoding, scale);
  for (double& weight : row) weight *= factor;
}

std::size_t nearest(const std::vector<Direction>& measured, const Vector& direction) {
  std::size_t best = 0;
  double largest = -2;
  for (std::size_t v = 0; v < measured.size(); ++v) {
    const Vector d = unit(measured[v]);
    const double cosine = d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2];
    if (cosine > largest) {
      largest = cosine;
      best = v;
    }
  }
  return best;
}

// The parts [P] of per-view values [V][P] of the views of that list, each `repeats` times.
template <typename T>
std::vector<T> parts_of_views(const std::vector<T>& values, std::size_t texels,
                              const std::vector<std::size_t>& views, std::size_t repeats) {
  std::vector<T> parts;
  if (values.empty()) return parts;
  parts.reserve(views.size() * repeats * texels);
  for (const std::size_t view : views) {
    const auto first = values.begin() + static_cast<std::ptrdiff_t>(view * texels);
    for (std::size_t i = 0; i < repeats; ++i) {
      parts.insert(parts.end(), first, first + static_cast<std::ptrdiff_t>(texels));
    }
  }
  return parts;
}

bool at_zenith(const Direction& view) {
  return theta_degrees(view) * std::numbers::pi / 180 <= zenith_angle;
}

}  // namespace

Resampling resample_to(const BtfInfo& measured, const std::vector<Direction>& views,
                       const std::vector<Direction>& lights) {
  Resampling resampling = begin(measured);
  require_above_horizon(views, "new view");
  require_above_horizon(lights, "new light");
  if (views.empty() || lights.empty()) {
    fail_input("{} views and {} lights: at least one of each is needed", views.size(),
               lights.size());
  }
  const RadialBasis view_basis(measured.view_directions, "view");
  const RadialBasis light_basis(measured.light_directions, "light");
  resampling.new_views = views.size();
  resampling.new_lights = lights.size();
  for (const Direction& light : lights) {
    add_light(light_basis, measured, unit(light), resampling.lights);
  }
  resampling.views.resize(views.size() * view_basis.size());
  for (std::size_t v = 0; v < views.size(); ++v) {
    const Vector view = unit(views[v]);
    resampling.nearest.push_back(nearest(measured.view_directions, view));
    view_basis.weigh(view,
                     std::span(resampling.views).subspan(v * view_basis.size(), view_basis.size()));
  }
  for (std::size_t v = 0; v < resampling.measured_views; ++v) resampling.frames.push_back({v, 0});
  BtfInfo& info = resampling.info;
  info.view_directions = views;
  info.light_directions = lights;
  info.shape.views = views.size();
  info.shape.lights = lights.size();
  return resampling;
}

Resampling resample_to(const BtfInfo& measured, const OnionSizes& sizes) {
  Resampling resampling = begin(measured);
  const OnionSlices grid(sizes);
  resampling.new_views = sizes.views();
  resampling.new_lights = sizes.lights();
  const std::size_t V = resampling.measured_views;
  const RadialBasis light_basis(measured.light_directions, "light");
  // Make a zenith view if there is none.
  std::vector<Direction> views = measured.view_directions;
  if (std::none_of(views.begin(), views.end(), at_zenith)) {
    resampling.zenith.resize(V);
    RadialBasis(views, "view").weigh({0, 0, 1}, resampling.zenith);
    views.push_back({0, 0, 1});
  }
  const RadialBasis view_basis(views, "view");
  // Frames: a view's own turn, or of a view at the zenith all turns.
  std::vector<std::size_t> frame_of;
  const auto add_frame = [&](std::size_t view, double turn) {
    resampling.frames.push_back({view, resampling.frames.size()});
    for (std::size_t l = 0; l < sizes.lights(); ++l) {
      const std::size_t slice = l / sizes.beta;
      const std::size_t place = l % sizes.beta;
      const Vector light =
          grid.turned_light(static_cast<double>(slice), static_cast<double>(place));
      add_light(light_basis, measured, turned_by(light, -turn), resampling.lights);
    }
  };
  for (std::size_t v = 0; v < views.size(); ++v) {
    frame_of.push_back(resampling.frames.size());
    if (!at_zenith(views[v])) {
      add_frame(v, phi_degrees(views[v]));
      continue;
    }
    for (std::size_t k = 0; k < sizes.phi; ++k) add_frame(v, grid.phi(k));
  }
  const std::size_t F = resampling.frames.size();
  // Views.
  resampling.views.assign(sizes.views() * F, 0.0);
  std::vector<double> weights(views.size());
  for (std::size_t k = 0; k < sizes.phi; ++k) {
    for (std::size_t j = 0; j < sizes.theta; ++j) {
      const Vector view = grid.view(static_cast<double>(k), static_cast<double>(j));
      view_basis.weigh(view, weights);
      const std::size_t row = (k * sizes.theta + j) * F;
      for (std::size_t v = 0; v < views.size(); ++v) {
        resampling.views[row + frame_of[v] + (at_zenith(views[v]) ? k : 0)] = weights[v];
      }
      resampling.nearest.push_back(nearest(measured.view_directions, view));
    }
  }
  // Pairs.
  BtfInfo& info = resampling.info;
  info.layout = Layout::paired;
  info.shape.views = sizes.views() * sizes.lights();
  info.shape.lights = 1;
  info.view_directions.clear();
  info.light_directions.clear();
  const std::vector<Direction> new_views = grid.views();
  for (std::size_t k = 0; k < sizes.phi; ++k) {
    const std::vector<Direction> lights = grid.lights(k);
    for (std::size_t j = 0; j < sizes.theta; ++j) {
      info.view_directions.insert(info.view_directions.end(), lights.size(),
                                  new_views[k * sizes.theta + j]);
      info.light_directions.insert(info.light_directions.end(), lights.begin(), lights.end());
    }
  }
  return resampling;
}

void take_masks(const BtfInfo& measured, const Resampling& resampling, BtfInfo& info) {
  const std::size_t texels = measured.shape.texels();
  const std::size_t repeats = info.shape.views / resampling.new_views;
  info.mask = parts_of_views(measured.mask, texels, resampling.nearest, repeats);
  info.mask_distance = parts_of_views(measured.mask_distance, texels, resampling.nearest, repeats);
}

std::size_t mask_bytes(const BtfInfo& measured, const Resampling& resampling) {
  const std::size_t texel = (measured.mask.empty() ? 0 : sizeof(std::uint8_t)) +
                            (measured.mask_distance.empty() ? 0 : sizeof(float));
  return resampling.info.shape.views * measured.shape.texels() * texel;
}

}  // namespace weft
