#include "weft/scene/noise.hpp"

#include <cmath>

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

}  // namespace weft
