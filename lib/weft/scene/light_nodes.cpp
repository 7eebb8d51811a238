#include "weft/scene/light_nodes.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "weft/btf/hemisphere.hpp"
#include "weft/scene/hemisphere_chart.hpp"

namespace weft {
namespace {

constexpr double hemisphere_angle = 2 * std::numbers::pi;
constexpr std::size_t least_side = 6, largest_side = 32;
// Points of a cell that its mean is taken of, along each axis.
constexpr std::size_t points_per_side = 6;

}  // namespace

std::size_t LightNodes::side_of(std::size_t lights) {
  const double cells = 2 * static_cast<double>(lights);
  return std::clamp(static_cast<std::size_t>(std::ceil(std::sqrt(cells))), least_side,
                    largest_side);
}

LightNodes::LightNodes(std::span<const Direction> lights, Quantity quantity)
    : side_(side_of(lights.size())), albedo_weights_(lights.size()) {
  const Hemisphere hemisphere(lights);
  const double points = points_per_side * static_cast<double>(side_);
  constexpr double share = 1.0 / (points_per_side * points_per_side);
  double cosines = 0;
  for (std::size_t row = 0; row < side_; ++row) {
    for (std::size_t column = 0; column < side_; ++column) {
      std::map<std::uint32_t, double> sums;
      double cosine = 0;
      for (std::size_t j = 0; j < points_per_side * points_per_side; ++j) {
        const std::size_t point_row = row * points_per_side + j / points_per_side;
        const std::size_t point_column = column * points_per_side + j % points_per_side;
        const auto down = static_cast<double>(point_row);
        const auto across = static_cast<double>(point_column);
        const std::array<double, 3> direction =
            hemisphere_of_square({(down + 0.5) / points, (across + 0.5) / points});
        const DirectionWeights weights = hemisphere.at(direction);
        const double factor = quantity == Quantity::brdf ? direction[2] : weights.scale;
        for (std::size_t k = 0; k < 3; ++k) {
          if (weights.weight[k] == 0) continue;
          sums[weights.index[k]] += share * factor * weights.weight[k];
        }
        cosine += share * direction[2];
      }
      first_.push_back(terms_.size());
      for (const auto& [light, weight] : sums) {
        terms_.push_back({light, weight});
        albedo_weights_[light] += weight * hemisphere_angle / static_cast<double>(count());
      }
      defence_.push_back(cosine);
      cosines += cosine;
    }
  }
  first_.push_back(terms_.size());
  for (double& part : defence_) part *= defensive_share * static_cast<double>(count()) / cosines;
}

void LightNodes::gather(std::span<const double> luminances, std::span<double> nodes) const {
  for (std::size_t i = 0; i < count(); ++i) {
    double sum = 0;
    for (std::size_t k = first_[i]; k < first_[i + 1]; ++k) {
      sum += terms_[k].weight * luminances[terms_[k].light];
    }
    nodes[i] = sum;
  }
}

BilinearDensity LightNodes::density(std::span<const double> nodes) const {
  double sum = 0;
  for (const double node : nodes) sum += node;
  const double mean = sum / static_cast<double>(count());
  // what is too small to be divided by counts as black
  const bool black = !std::isnormal(mean);
  std::vector<double> values(count());
  for (std::size_t i = 0; i < count(); ++i) {
    values[i] = black ? defence_[i] / defensive_share
                      : (1 - defensive_share) * nodes[i] / mean + defence_[i];
  }
  return {side_, side_, std::move(values)};
}

LightNodes::Tables LightNodes::tables() const {
  Tables tables;
  for (const std::size_t first : first_) tables.first.push_back(static_cast<std::uint32_t>(first));
  for (const Term& term : terms_) {
    tables.lights.push_back(term.light);
    tables.weights.push_back(static_cast<float>(term.weight));
  }
  for (const double part : defence_) tables.defence.push_back(static_cast<float>(part));
  return tables;
}

double slice_luminance(std::span<const double> channels) {
  if (channels.size() == 3) {
    return 0.2126 * std::max(channels[0], 0.0) + 0.7152 * std::max(channels[1], 0.0) +
           0.0722 * std::max(channels[2], 0.0);
  }
  double sum = 0;
  for (const double channel : channels) sum += std::max(channel, 0.0);
  return sum / static_cast<double>(channels.size());
}

LightOfSlice draw_light(const BilinearDensity& slice, const std::array<double, 2>& numbers) {
  const SquareSample drawn = slice.sample(numbers);
  return {hemisphere_of_square(drawn.place), drawn.density / hemisphere_angle};
}

double light_density(const BilinearDensity& slice, const std::array<double, 3>& direction) {
  if (direction[2] < 0) return 0;
  return slice.at(square_of_hemisphere(direction)) / hemisphere_angle;
}

}  // namespace weft
