#include "weft/scene/yarn_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "weft/error.hpp"
#include "weft/scene/tile_noise.hpp"

namespace weft {
namespace {

// How far tops and bottoms go on beyond a tube's edge, in half widths, and at least in cells: the
// outline lies between samples of the same tube.
constexpr double least_apron = 0.35;
constexpr double least_apron_cells = 1.5;
// How fast they pass each other there, in half thicknesses per half width.
constexpr double apron_slope = 2;
// Half thickness of what is no material at all.
constexpr double void_depth = 0.02;

// A steep tube is cut aslant by the vertical; by so much at most, near its turns.
constexpr double steepest = 1.5;

constexpr std::int64_t fibres_per_ply = 4;

// The nearest place of a curve to a sample, so far.
struct Nearest {
  std::size_t index = 0;
  double distance = std::numeric_limits<double>::infinity();  // squared, over half width squared
  double side = 0;    // offset to the left of the curve, over half the width
  double length = 0;  // along the curve
  double z = 0, half = 0, half_thickness = 0;
  double along_x = 1, along_y = 0;
};

}  // namespace

void clear_layers(Surface& surface) {
  const std::size_t count = surface.columns * surface.rows;
  for (SurfaceLayer& layer : surface.layers) {
    layer.elevation.assign(count, static_cast<float>(-void_depth));
    layer.underside.assign(count, static_cast<float>(void_depth));
  }
}

void sweep_yarn(Surface& surface, std::size_t layer_index, const SweptYarn& yarn,
                const YarnCurve& curve) {
  SurfaceLayer& layer = surface.layers[layer_index];
  const std::size_t count = curve.points.size();
  const auto girth = [&](std::size_t i) {
    return curve.girth.empty() ? 1.0 : curve.girth[i % count];
  };

  // The nearest place, sample by sample, of all lines that come near it.
  constexpr std::uint32_t none = 0xffffffffu;
  std::vector<std::uint32_t> slots(surface.columns * surface.rows, none);
  std::vector<Nearest> touched;
  const double cell = std::max(surface.width / static_cast<double>(surface.columns),
                               surface.depth / static_cast<double>(surface.rows));
  double length = 0;
  for (std::size_t i = 0; i + (curve.closed ? 0 : 1) < count; ++i) {
    const std::array<double, 3>& a = curve.points[i];
    std::array<double, 3> b = curve.points[(i + 1) % count];
    if (i + 1 == count) {
      b[0] += curve.closing[0];
      b[1] += curve.closing[1];
    }
    const double run_x = b[0] - a[0], run_y = b[1] - a[1], rise = b[2] - a[2];
    const double run = std::hypot(run_x, run_y);
    if (run <= 0) continue;
    check_interrupt();
    const double full = std::hypot(run, rise);
    const double widest = 0.5 * yarn.width * std::max(girth(i), girth(i + 1));
    const double reach = 1 + std::max(least_apron, least_apron_cells * cell / widest);
    draw_around(surface, 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), reach * widest + 0.5 * run,
                [&](std::size_t index, double dx, double dy) {
                  const double px = dx + 0.5 * run_x, py = dy + 0.5 * run_y;
                  const double t = std::clamp((px * run_x + py * run_y) / (run * run), 0.0, 1.0);
                  const double ox = px - t * run_x, oy = py - t * run_y;
                  const double size = girth(i) + t * (girth(i + 1) - girth(i));
                  const double half = 0.5 * yarn.width * size;
                  const double distance = (ox * ox + oy * oy) / (half * half);
                  if (distance > reach * reach) return;
                  if (slots[index] == none) {
                    slots[index] = static_cast<std::uint32_t>(touched.size());
                    touched.emplace_back().index = index;
                  }
                  Nearest& best = touched[slots[index]];
                  if (distance >= best.distance) return;
                  best.distance = distance;
                  best.side = std::copysign(std::sqrt(distance), run_x * oy - run_y * ox);
                  best.length = length + t * full;
                  best.z = a[2] + t * rise;
                  best.half = half;
                  best.half_thickness =
                      0.5 * yarn.thickness * size * std::min(full / run, steepest);
                  best.along_x = run_x / run;
                  best.along_y = run_y / run;
                });
    length += full;
  }

  // A whole number of plies passes over the closed curve, so that the twist meets itself.
  const auto plies = static_cast<double>(yarn.plies);
  const auto passes = std::llround(yarn.twists * length);
  const double turns = static_cast<double>(passes) / length;
  const std::int64_t fibre_period =
      fibres_per_ply * std::max<std::int64_t>(1, std::abs(static_cast<std::int64_t>(passes)));
  const double fibre_cells = std::max(1.0, std::round(1.5 * length / yarn.width));
  const double shade_cells = std::max(1.0, std::round(0.7 * length / yarn.width));
  const double own_shade = 1 + yarn.color_spread * (2 * hash_unit(yarn.key + 1) - 1);

  for (const Nearest& at : touched) {
    const std::size_t index = at.index;
    const double u = std::abs(at.side);
    double top = 0, bottom = 0, shade = 1;
    double fibre_x = at.along_x, fibre_y = at.along_y;
    const bool material = u < 1;
    if (material) {
      const double angle = std::asin(std::clamp(at.side, -1.0, 1.0));
      const double ply = plies * (angle / std::numbers::pi + 0.5) + turns * at.length;
      const double across = 2 * (ply - std::floor(ply)) - 1;
      const double round = std::sqrt(std::max(0.0, 1 - across * across));
      const double fibre =
          value_noise(static_cast<double>(fibres_per_ply) * ply, at.length / length * fibre_cells,
                      fibre_period, static_cast<std::int64_t>(fibre_cells), yarn.key + 2);
      const double section = std::sqrt(1 - u * u);
      const double relief = section * (yarn.ply_relief * (round - 1) + yarn.fibre_relief * fibre);
      top = at.z + at.half_thickness * section + relief;
      bottom = at.z - at.half_thickness * section;
      const double slope = -section * at.half * std::numbers::pi * turns / plies;
      fibre_x = at.along_x - slope * at.along_y;
      fibre_y = at.along_y + slope * at.along_x;
      const double along = value_noise(at.length / length * shade_cells,
                                       static_cast<std::int64_t>(shade_cells), yarn.key + 3);
      shade = own_shade * (1 + 0.5 * yarn.color_spread * along + 1.2 * yarn.color_spread * fibre) *
              (0.72 + 0.28 * round);
    } else {
      const double past = apron_slope * at.half_thickness * (u - 1);
      top = at.z - past;
      bottom = at.z + past;
    }

    // Material hides what is none, and the higher material the lower.
    const bool taken = layer.elevation[index] >= layer.underside[index];
    const bool blank = layer.elevation[index] == static_cast<float>(-void_depth) &&
                       layer.underside[index] == static_cast<float>(void_depth);
    if (taken && !material) continue;
    if (taken) bottom = std::min<double>(bottom, layer.underside[index]);
    if (taken && top <= layer.elevation[index]) {
      layer.underside[index] = static_cast<float>(bottom);
      continue;
    }
    if (!taken && !material && !blank &&
        bottom - top >= static_cast<double>(layer.underside[index]) - layer.elevation[index]) {
      continue;
    }
    layer.elevation[index] = static_cast<float>(top);
    layer.underside[index] = static_cast<float>(bottom);
    const double norm = std::hypot(fibre_x, fibre_y);
    layer.samples[index].fibre_x = static_cast<float>(fibre_x / norm);
    layer.samples[index].fibre_y = static_cast<float>(fibre_y / norm);
    layer.colors[index] = {shaded(yarn.color, shade), static_cast<float>(yarn.lobe)};
  }
}

}  // namespace weft
