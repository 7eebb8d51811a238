#include "weft/reference/surface_march.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace weft {
namespace {

struct Point {
  double x = 0, y = 0, z = 0;
};

struct Ray {
  Point start, step;
  Point at(double k) const {
    return {start.x + k * step.x, start.y + k * step.y, start.z + k * step.z};
  }
};

// Where a point is relative to a layer: inside where both are negative.
struct Clearance {
  double above = 0, below = 0;
};

Clearance clearance(const Surface& surface, const SurfaceLayer& layer, const Point& p) {
  const double above = p.z - height_at(surface, layer.elevation, p.x, p.y);
  if (layer.underside.empty()) return {above, -1};
  return {above, height_at(surface, layer.underside, p.x, p.y) - p.z};
}

std::vector<Clearance> clearances(const Surface& surface, const Point& p) {
  std::vector<Clearance> all;
  for (const SurfaceLayer& layer : surface.layers) all.push_back(clearance(surface, layer, p));
  return all;
}

// The part of a step over which a linear quantity is at most 0.
struct Interval {
  double in = 0, out = 1;
};
Interval inside_part(double from, double to) {
  Interval part;
  if (from > 0) part.in = to <= 0 ? from / (from - to) : 2;
  if (to > 0) part.out = from <= 0 ? from / (from - to) : -1;
  return part;
}

// Where in a step, from 0 to 1, a layer is entered, and through which face.
struct StepEntry {
  double when = 2;  // nowhere
  bool under = false;
  double outside_high = 0, outside_low = 0;  // distances from that face before and after the step
};

StepEntry entry_of_step(const Clearance& before, const Clearance& after, bool solid,
                        double& margin) {
  const Interval top = inside_part(before.above, after.above);
  const StepEntry through_top{top.in, false, before.above, after.above};
  margin = std::min(margin, std::abs(after.above));
  if (solid) return after.above <= 0 ? through_top : StepEntry{};
  const Interval bottom = inside_part(before.below, after.below);
  const StepEntry through_underside{bottom.in, true, before.below, after.below};
  margin = std::min(margin, std::abs(after.below));
  const bool both = top.in <= 1 && bottom.in <= 1 && top.out >= 0 && bottom.out >= 0;
  if (!both) return {};
  const double in = std::max(top.in, bottom.in), out = std::min(top.out, bottom.out);
  const double drop =
      std::min(std::abs(before.above - after.above), std::abs(before.below - after.below));
  margin = std::min({margin, std::abs(in - out) * drop, std::abs(top.in - bottom.in) * drop});
  if (in > out) return {};
  return bottom.in > top.in ? through_underside : through_top;
}

// The first entry of a ray, of `steps` steps. `to_floor`: the last point lies at the lowest
// elevation of all, which a solid layer can't be missed at.
SurfaceHit trace(const Surface& surface, const Ray& ray, std::size_t steps, bool to_floor,
                 double& margin) {
  std::vector<Clearance> before = clearances(surface, ray.start);
  for (std::size_t step = 1; step <= steps; ++step) {
    double low = static_cast<double>(step), high = low - 1;
    const std::vector<Clearance> after = clearances(surface, ray.at(low));
    StepEntry first;
    SurfaceHit hit;
    for (std::size_t l = 0; l < surface.layers.size(); ++l) {
      const bool solid = surface.layers[l].underside.empty();
      Clearance end = after[l];
      double at_floor = widest_margin;  // decides nothing
      const bool certain = solid && to_floor && step == steps;
      if (certain) end.above = std::min(end.above, 0.0);
      const StepEntry entry = entry_of_step(before[l], end, solid, certain ? at_floor : margin);
      if (entry.when > 1) continue;
      if (hit.met) {
        margin = std::min(margin, std::abs(entry.when - first.when) *
                                      std::abs(entry.outside_high - entry.outside_low));
      }
      if (entry.when < first.when) {
        first = entry;
        hit.met = true;
        hit.layer = l;
        hit.under = entry.under;
      }
    }
    if (!hit.met) {
      before = after;
      continue;
    }
    // Halve the step, then take the chord.
    const SurfaceLayer& layer = surface.layers[hit.layer];
    for (int i = 0; i < ray_bisections; ++i) {
      const double middle = 0.5 * (high + low);
      const Clearance there = clearance(surface, layer, ray.at(middle));
      const double outside = hit.under ? there.below : there.above;
      if (outside > 0) {
        high = middle;
        first.outside_high = outside;
      } else {
        low = middle;
        first.outside_low = outside;
      }
    }
    const double drop = first.outside_high - first.outside_low;
    const double k =
        drop > 0 ? high + (low - high) * (std::max(first.outside_high, 0.0) / drop) : high;
    const Point p = ray.at(k);
    hit.x = p.x;
    hit.y = p.y;
    hit.z = height_at(surface, hit.under ? layer.underside : layer.elevation, p.x, p.y);
    return hit;
  }
  return {};
}

// Where rays that leave a hit begin.
Point departure(const Surface& surface, const SurfaceHit& hit) {
  const double bias = shadow_bias(surface);
  return {hit.x, hit.y, hit.under ? hit.z - bias : hit.z + bias};
}

// Whether a layer stands in the way of a step of a shadow ray.
bool blocks(const Clearance& before, const Clearance& after, bool solid, double& margin) {
  margin = std::min(margin, std::abs(after.above));
  if (solid) return after.above < 0;
  margin = std::min(margin, std::abs(after.below));
  if (after.above < 0 && after.below < 0) return true;
  const bool down = before.above >= 0 && before.below < 0 && after.above < 0 && after.below >= 0;
  const bool up = before.above < 0 && before.below >= 0 && after.above >= 0 && after.below < 0;
  if (!down && !up) return false;
  // A sheet passed downwards was met if its top came before its underside; and so upwards.
  const double order = before.above * after.below - before.below * after.above;
  margin = std::min(margin, std::abs(order) / (std::abs(before.above - after.above) +
                                               std::abs(before.below - after.below)));
  return down ? order < 0 : order > 0;
}

double range_of(const Surface& surface) {
  return static_cast<double>(surface.highest) - surface.lowest;
}

}  // namespace

ViewMarch march_of_view(const Surface& surface, const Direction& view) {
  const Vector3 v = normalized({view[0], view[1], view[2]});
  const double cells_x = v[0] * static_cast<double>(surface.columns) / surface.width;
  const double cells_y = v[1] * static_cast<double>(surface.rows) / surface.depth;
  const double up = (static_cast<double>(surface.highest) - surface.reference) / v[2];
  const double length = range_of(surface) / v[2];
  const double cells = std::ceil(length * std::max(std::abs(cells_x), std::abs(cells_y)));
  const double steps = std::max(1.0, cells);
  return {cells_x * up,
          cells_y * up,
          surface.highest,
          -cells_x * length / steps,
          -cells_y * length / steps,
          -range_of(surface) / steps,
          static_cast<std::size_t>(steps)};
}

StepMarch march_along(const Surface& surface, const Vector3& direction) {
  const double cells_x = direction[0] * static_cast<double>(surface.columns) / surface.width;
  const double cells_y = direction[1] * static_cast<double>(surface.rows) / surface.depth;
  // At the zenith the first step passes over everything there is.
  const double longest = 1 + 2 * range_of(surface);
  const double length = 1 / std::max({std::abs(cells_x), std::abs(cells_y), 1 / longest});
  return {cells_x * length, cells_y * length, direction[2] * length};
}

double shadow_bias(const Surface& surface) {
  return 0.25 * std::min(surface.width / static_cast<double>(surface.columns),
                         surface.depth / static_cast<double>(surface.rows));
}

std::size_t bounce_reach(const Surface& surface) {
  return surface.columns + surface.rows;
}

SurfacePatch patch_at(const Surface& surface, double x, double y) {
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

double height_at(const Surface& surface, const std::vector<float>& table, double x, double y) {
  const SurfacePatch patch = patch_at(surface, x, y);
  double z = 0;
  for (std::size_t i = 0; i < 4; ++i) z += patch.weight[i] * table[patch.index[i]];
  return z;
}

SurfaceHit trace_view(const Surface& surface, const ViewMarch& march, double x, double y,
                      double& margin) {
  const Ray ray{{x + march.start_x, y + march.start_y, march.start_z},
                {march.step_x, march.step_y, march.step_z}};
  return trace(surface, ray, march.steps, true, margin);
}

SurfaceHit trace_from(const Surface& surface, const SurfaceHit& hit, const Vector3& direction,
                      double& margin) {
  const StepMarch march = march_along(surface, direction);
  const Ray ray{departure(surface, hit), {march.step_x, march.step_y, march.step_z}};
  // March as far as there can be anything.
  const auto reach = static_cast<double>(bounce_reach(surface));
  const double way = (ray.step.z > 0 ? surface.highest : surface.lowest) - ray.start.z;
  const double steps = ray.step.z != 0 ? std::ceil(way / ray.step.z) : reach;
  return trace(surface, ray, static_cast<std::size_t>(std::clamp(steps, 0.0, reach)), false,
               margin);
}

bool is_lit(const Surface& surface, const StepMarch& march, const SurfaceHit& hit, double& margin) {
  const Ray ray{departure(surface, hit), {march.step_x, march.step_y, march.step_z}};
  std::vector<Clearance> before = clearances(surface, ray.start);
  for (double k = 1;; ++k) {
    const Point p = ray.at(k);
    const std::vector<Clearance> after = clearances(surface, p);
    for (std::size_t l = 0; l < surface.layers.size(); ++l) {
      const bool solid = surface.layers[l].underside.empty();
      if (blocks(before[l], after[l], solid, margin)) return false;
    }
    if (p.z >= surface.highest) return true;
    before = after;
  }
}

}  // namespace weft
