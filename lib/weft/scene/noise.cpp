#include "weft/scene/noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace weft {
namespace {

// A lattice coordinate with its neighbour, wrapped, and a smooth weight between them.
struct LatticeStep {
  std::uint64_t first, second;
  double weight;
};

LatticeStep lattice_step(double x, std::int64_t period) {
  const double cell = std::floor(x);
  const double f = x - cell;
  const auto wrap = [period](std::int64_t i) {
    return static_cast<std::uint64_t>((i % period + period) % period);
  };
  const auto i = static_cast<std::int64_t>(cell);
  return {wrap(i), wrap(i + 1), f * f * (3 - 2 * f)};
}

double blend(double a, double b, double weight) {
  return a + (b - a) * weight;
}

}  // namespace

std::uint64_t hash(std::uint64_t value) {
  value += 0x9e3779b97f4a7c15u;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9u;
  value = (value ^ (value >> 27)) * 0x94d049bb133111ebu;
  return value ^ (value >> 31);
}

double hash_unit(std::uint64_t key) {
  return static_cast<double>(hash(key) >> 11) * 0x1p-53;
}

double value_noise(double x, std::int64_t period, std::uint64_t key) {
  const LatticeStep step = lattice_step(x, period);
  return 2 * blend(hash_unit(key ^ hash(step.first)), hash_unit(key ^ hash(step.second)),
                   step.weight) -
         1;
}

double value_noise(double x, double y, std::int64_t period_x, std::int64_t period_y,
                   std::uint64_t key) {
  const LatticeStep sx = lattice_step(x, period_x);
  const LatticeStep sy = lattice_step(y, period_y);
  const auto corner = [key](std::uint64_t i, std::uint64_t j) {
    return hash_unit(key ^ hash(i ^ hash(j)));
  };
  const double low = blend(corner(sx.first, sy.first), corner(sx.second, sy.first), sx.weight);
  const double high = blend(corner(sx.first, sy.second), corner(sx.second, sy.second), sx.weight);
  return 2 * blend(low, high, sy.weight) - 1;
}

double gradient_noise(double x, double y, std::int64_t period_x, std::int64_t period_y,
                      std::uint64_t key) {
  const LatticeStep sx = lattice_step(x, period_x);
  const LatticeStep sy = lattice_step(y, period_y);
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  // The part of a corner's gradient along the way to it. Eight directions are enough to be unseen.
  constexpr double d = std::numbers::sqrt2 / 2;
  constexpr std::array<std::array<double, 2>, 8> directions = {
      {{1, 0}, {d, d}, {0, 1}, {-d, d}, {-1, 0}, {-d, -d}, {0, -1}, {d, -d}}};
  const auto corner = [&](std::uint64_t i, std::uint64_t j, double dx, double dy) {
    const std::array<double, 2>& gradient = directions[hash(key ^ hash(i ^ hash(j))) >> 61];
    return gradient[0] * dx + gradient[1] * dy;
  };
  const auto fade = [](double f) { return f * f * f * (f * (6 * f - 15) + 10); };
  const double wx = fade(fx);
  const double low =
      blend(corner(sx.first, sy.first, fx, fy), corner(sx.second, sy.first, fx - 1, fy), wx);
  const double high = blend(corner(sx.first, sy.second, fx, fy - 1),
                            corner(sx.second, sy.second, fx - 1, fy - 1), wx);
  return std::numbers::sqrt2 * blend(low, high, fade(fy));
}

double fractal_noise(double x, double y, std::int64_t period_x, std::int64_t period_y, int octaves,
                     std::uint64_t key) {
  double sum = 0, height = 1, frequency = 1;
  std::int64_t factor = 1;
  for (int i = 0; i < octaves; ++i) {
    sum += height * gradient_noise(frequency * x, frequency * y, factor * period_x,
                                   factor * period_y, hash(key + static_cast<std::uint64_t>(i)));
    height *= 0.5;
    frequency *= 2;
    factor *= 2;
  }
  return sum;
}

Cell cell_at(double x, double y, std::int64_t period_x, std::int64_t period_y, double jitter,
             std::uint64_t key) {
  const double column = std::floor(x), row = std::floor(y);
  Cell cell;
  cell.nearest = cell.second = std::numeric_limits<double>::infinity();
  double second_x = 0, second_y = 0;
  // The points of a square are no nearer than its part that they are scattered over.
  const auto gap = [jitter](double from) { return std::max(0.0, std::abs(from) - 0.5 * jitter); };
  // Of displaced points, the two nearest lie within two squares; the nearer squares come first.
  constexpr std::array<int, 5> order = {0, -1, 1, -2, 2};
  for (const int j : order) {
    const double gap_y = gap(y - (row + j + 0.5));
    for (const int i : order) {
      const double gap_x = gap(x - (column + i + 0.5));
      if (gap_x * gap_x + gap_y * gap_y >= cell.second * cell.second) continue;
      const LatticeStep sx = lattice_step(column + i, period_x);
      const LatticeStep sy = lattice_step(row + j, period_y);
      const std::uint64_t id = hash(key ^ hash(sx.first ^ hash(sy.first)));
      const double dx = x - (column + i + 0.5 + jitter * (hash_unit(id + 1) - 0.5));
      const double dy = y - (row + j + 0.5 + jitter * (hash_unit(id + 2) - 0.5));
      const double distance = std::sqrt(dx * dx + dy * dy);
      if (distance < cell.nearest) {
        cell.second = cell.nearest;
        second_x = cell.offset_x;
        second_y = cell.offset_y;
        cell.nearest = distance;
        cell.offset_x = dx;
        cell.offset_y = dy;
        cell.id = id;
      } else if (distance < cell.second) {
        cell.second = distance;
        second_x = dx;
        second_y = dy;
      }
    }
  }
  const double apart = std::hypot(second_x - cell.offset_x, second_y - cell.offset_y);
  cell.border =
      apart > 0 ? (cell.second * cell.second - cell.nearest * cell.nearest) / (2 * apart) : 0;
  return cell;
}

}  // namespace weft
