// What makers of materials share: noise at a size in the tile's own units, which repeats with the
// tile, and surfaces from a function of the place.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "weft/scene/noise.hpp"
#include "weft/scene/surface.hpp"

namespace weft {

// Noise over a tile of width x depth: the sizes of features are met as nearly as whole numbers of
// them fit.
class TileNoise {
 public:
  TileNoise(double width, double depth, std::uint64_t seed)
      : width_(width), depth_(depth), key_(hash(seed)) {}

  // Octaves from `size` down; `stretch` > 1 draws features out along y by that factor.
  double fractal(double x, double y, double size, int octaves, std::uint64_t key,
                 double stretch = 1) const {
    const double px = fitting(width_, size), py = fitting(depth_, size * stretch);
    return fractal_noise(x * px / width_, y * py / depth_, static_cast<std::int64_t>(px),
                         static_cast<std::int64_t>(py), octaves, hash(key_ + key));
  }

  Cell cell(double x, double y, double size, double jitter, std::uint64_t key) const {
    const double px = fitting(width_, size), py = fitting(depth_, size);
    return cell_at(x * px / width_, y * py / depth_, static_cast<std::int64_t>(px),
                   static_cast<std::int64_t>(py), jitter, hash(key_ + key));
  }

  std::uint64_t key(std::uint64_t purpose) const { return hash(key_ + purpose); }

 private:
  // How many features of a size fit into a length.
  static double fitting(double length, double size) {
    return std::max(1.0, std::round(length / size));
  }

  double width_, depth_;
  std::uint64_t key_;
};

// What a surface shows at a place.
struct SurfacePoint {
  double elevation = 0;
  double fibre_x = 1, fibre_y = 0;  // seen from above; any length but 0
  std::array<float, 3> albedo{};
  std::size_t lobe = 0;
};

// A solid from point = at(x, y, index of the sample), with x and y in the tile's units.
template <typename At>
Surface make_solid(std::size_t columns, std::size_t rows, const std::array<double, 2>& tile,
                   std::vector<GlossyLobe> lobes, const At& at) {
  Surface surface = make_flat_surface(columns, rows, tile[0], tile[1]);
  surface.lobes = std::move(lobes);
  SurfaceLayer& layer = surface.layers.front();
  for (std::size_t r = 0; r < rows; ++r) {
    const double y = static_cast<double>(r) * tile[1] / static_cast<double>(rows);
    for (std::size_t c = 0; c < columns; ++c) {
      const double x = static_cast<double>(c) * tile[0] / static_cast<double>(columns);
      const std::size_t index = r * columns + c;
      const SurfacePoint point = at(x, y, index);
      const double length = std::hypot(point.fibre_x, point.fibre_y);
      layer.elevation[index] = static_cast<float>(point.elevation);
      layer.samples[index].fibre_x = static_cast<float>(point.fibre_x / length);
      layer.samples[index].fibre_y = static_cast<float>(point.fibre_y / length);
      layer.colors[index] = {point.albedo, static_cast<float>(point.lobe)};
    }
  }
  finish_surface(surface);
  return surface;
}

// Calls draw(index, dx, dy) for every sample within `radius` of (x, y), at most once round the
// tile; dx and dy lead there from (x, y).
template <typename Draw>
void draw_around(const Surface& surface, double x, double y, double radius, const Draw& draw) {
  const auto side = [radius](double place, double length, std::size_t count) {
    const double cell = length / static_cast<double>(count);
    const auto first = static_cast<std::int64_t>(std::ceil((place - radius) / cell));
    const auto last = static_cast<std::int64_t>(std::floor((place + radius) / cell));
    return std::array<std::int64_t, 2>{
        first, std::min(last, first + static_cast<std::int64_t>(count) - 1)};
  };
  const auto [left, right] = side(x, surface.width, surface.columns);
  const auto [bottom, top] = side(y, surface.depth, surface.rows);
  for (std::int64_t r = bottom; r <= top; ++r) {
    const double dy =
        static_cast<double>(r) * surface.depth / static_cast<double>(surface.rows) - y;
    const std::size_t row = static_cast<std::size_t>(r) & (surface.rows - 1);
    for (std::int64_t c = left; c <= right; ++c) {
      const double dx =
          static_cast<double>(c) * surface.width / static_cast<double>(surface.columns) - x;
      if (dx * dx + dy * dy > radius * radius) continue;
      draw(row * surface.columns + (static_cast<std::size_t>(c) & (surface.columns - 1)), dx, dy);
    }
  }
}

// Keeps what layers hold in holes, next to their outlines, as near to the material's bounds as
// `validate` asks for.
inline void bound_holes(Surface& surface) {
  float low = std::numeric_limits<float>::infinity(), high = -low;
  for (const SurfaceLayer& layer : surface.layers) {
    for (std::size_t i = 0; i < layer.elevation.size(); ++i) {
      const bool solid = layer.underside.empty();
      if (!solid && layer.elevation[i] < layer.underside[i]) continue;
      low = std::min(low, solid ? layer.elevation[i] : layer.underside[i]);
      high = std::max(high, layer.elevation[i]);
    }
  }
  const float beyond = 0.5f * (high - low);
  for (SurfaceLayer& layer : surface.layers) {
    for (std::size_t i = 0; i < layer.underside.size(); ++i) {
      if (layer.elevation[i] >= layer.underside[i]) continue;
      layer.elevation[i] = std::clamp(layer.elevation[i], low - beyond, high);
      layer.underside[i] = std::clamp(layer.underside[i], low, high + beyond);
    }
  }
}

// A colour times a factor, within [0, 1].
inline std::array<float, 3> shaded(const std::array<float, 3>& color, double factor) {
  std::array<float, 3> result;
  for (std::size_t i = 0; i < 3; ++i) {
    result[i] = static_cast<float>(std::clamp(color[i] * factor, 0.0, 1.0));
  }
  return result;
}

inline std::array<float, 3> mixed(const std::array<float, 3>& a, const std::array<float, 3>& b,
                                  double weight) {
  std::array<float, 3> result;
  for (std::size_t i = 0; i < 3; ++i) {
    result[i] = static_cast<float>(a[i] + (b[i] - a[i]) * std::clamp(weight, 0.0, 1.0));
  }
  return result;
}

// 0 below `low`, 1 above `high`, smooth between.
inline double smooth_step(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// The shortest way from b to a round a period.
inline double periodic_offset(double a, double b, double period) {
  const double offset = a - b;
  return offset - period * std::round(offset / period);
}

}  // namespace weft
