#include "weft/btf/mask_distance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr std::size_t unreached = std::numeric_limits<std::size_t>::max();

// Steps along its column, round the border, from each texel to the nearest one of kind `other`.
std::vector<std::size_t> steps_along_columns(std::span<const std::uint8_t> mask, std::size_t height,
                                             std::size_t width, bool other) {
  std::vector<std::size_t> steps(height * width, unreached);
  if (height == 0) return steps;
  for (std::size_t x = 0; x < width; ++x) {
    // Twice down and twice up: the second turn knows what lies across the border.
    std::size_t since = unreached;
    const auto visit = [&](std::size_t y) {
      const std::size_t i = y * width + x;
      if ((mask[i] != 0) == other) {
        since = 0;
      } else if (since != unreached) {
        ++since;
      }
      steps[i] = std::min(steps[i], since);
    };
    for (std::size_t i = 0; i < 2 * height; ++i) visit(i % height);
    since = unreached;
    for (std::size_t i = 2 * height; i > 0; --i) visit((i - 1) % height);
  }
  return steps;
}

// Distance of every texel to the nearest one of kind `other`, both measured at their centres.
void fill_distances(std::span<const std::uint8_t> mask, std::size_t height, std::size_t width,
                    bool other, std::span<double> distances) {
  // Views without holes are common, and would have every column searched from every texel.
  if (std::none_of(mask.begin(), mask.end(),
                   [other](std::uint8_t value) { return (value != 0) == other; })) {
    std::fill(distances.begin(), distances.end(), std::numeric_limits<double>::infinity());
    return;
  }
  const std::vector<std::size_t> steps = steps_along_columns(mask, height, width, other);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      if ((mask[y * width + x] != 0) == other) continue;
      // The nearest in each column is known; columns farther away than the best so far can't win.
      std::size_t best = unreached;
      for (std::size_t dx = 0; dx <= width / 2 && dx * dx < best; ++dx) {
        const std::size_t right = steps[y * width + (x + dx) % width];
        const std::size_t left = steps[y * width + (x + width - dx) % width];
        const std::size_t nearer = std::min(left, right);
        if (nearer != unreached) best = std::min(best, dx * dx + nearer * nearer);
      }
      distances[y * width + x] = best == unreached ? std::numeric_limits<double>::infinity()
                                                   : std::sqrt(static_cast<double>(best));
    }
  }
}

}  // namespace

std::vector<float> signed_distances(std::span<const std::uint8_t> mask, std::size_t height,
                                    std::size_t width) {
  if (mask.size() != height * width) {
    fail_input("mask distance: {} values instead of {} x {}", mask.size(), height, width);
  }
  std::vector<double> distances(mask.size());
  fill_distances(mask, height, width, false, distances);
  fill_distances(mask, height, width, true, distances);
  std::vector<float> result(mask.size());
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double distance = distances[i] - 0.5;
    result[i] = static_cast<float>(mask[i] != 0 ? distance : -distance);
  }
  return result;
}

ViewMask view_mask(std::span<const std::uint8_t> fine, std::size_t height, std::size_t width,
                   std::size_t factor) {
  const std::size_t fine_width = factor * width;
  const std::vector<float> distances = signed_distances(fine, factor * height, fine_width);
  const std::size_t parts = factor * factor;
  const double unit = 1 / static_cast<double>(factor);
  ViewMask view;
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      std::size_t covered = 0;
      double sum = 0;
      for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t i =
            (factor * y + part / factor) * fine_width + factor * x + part % factor;
        covered += fine[i] != 0 ? 1 : 0;
        sum += distances[i];
      }
      const bool material = 2 * covered >= parts;
      const double mean = unit * sum / static_cast<double>(parts);
      view.mask.push_back(material ? 1 : 0);
      view.distance.push_back(
          static_cast<float>(material ? std::max(mean, 0.5 * unit) : std::min(mean, -0.5 * unit)));
    }
  }
  return view;
}

void add_view_mask(std::span<const std::uint8_t> fine, std::size_t factor, BtfInfo& info) {
  const ViewMask view = view_mask(fine, info.shape.height, info.shape.width, factor);
  info.mask.insert(info.mask.end(), view.mask.begin(), view.mask.end());
  info.mask_distance.insert(info.mask_distance.end(), view.distance.begin(), view.distance.end());
}

void normalize_distances(std::span<float> distances) {
  float largest = 0;
  for (const float distance : distances) {
    if (std::isfinite(distance)) largest = std::max(largest, std::abs(distance));
  }
  for (float& distance : distances) {
    distance = std::isfinite(distance) ? distance / largest : std::copysign(1.0f, distance);
  }
}

}  // namespace weft
