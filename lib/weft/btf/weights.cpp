#include "weft/btf/weights.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string_view>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

// Cosines below this are those of 90 degrees, as they are in float.
constexpr double least_cosine = 1e-6;

double cosine(const Direction& direction) {
  const double x = direction[0];
  const double y = direction[1];
  const double z = direction[2];
  const double value = z / std::sqrt(x * x + y * y + z * z);
  return value < least_cosine ? 0.0 : value;
}

std::vector<double> products(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.empty()) return b;
  std::vector<double> result = a;
  if (!b.empty())
    std::transform(a.begin(), a.end(), b.begin(), result.begin(), std::multiplies<>());
  return result;
}

// To the mean 1; nothing if all are equal.
void normalise(std::vector<double>& weights, std::string_view mode) {
  const bool equal =
      std::adjacent_find(weights.begin(), weights.end(), std::not_equal_to<>()) == weights.end();
  if (equal && !weights.empty() && weights[0] == 0) {
    fail_input("weights: all {} that are selected have weight zero", mode);
  }
  if (equal) {
    weights.clear();
    return;
  }
  const double mean =
      std::accumulate(weights.begin(), weights.end(), 0.0) / static_cast<double>(weights.size());
  for (double& weight : weights) weight /= mean;
}

std::vector<double> picked(const std::vector<double>& weights,
                           const std::optional<std::vector<std::size_t>>& list) {
  if (weights.empty() || !list) return weights;
  std::vector<double> result;
  for (const std::size_t index : *list) result.push_back(weights.at(index));
  return result;
}

// The selected indices of positive weight.
std::optional<std::vector<std::size_t>> positive(
    const std::vector<double>& weights, const std::optional<std::vector<std::size_t>>& list,
    std::string_view mode) {
  if (weights.empty() || std::find(weights.begin(), weights.end(), 0.0) == weights.end()) {
    return list;
  }
  std::vector<std::size_t> all(weights.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  std::vector<std::size_t> kept;
  for (const std::size_t index : list.value_or(all)) {
    if (weights.at(index) > 0) kept.push_back(index);
  }
  if (kept.empty()) fail_input("weights: all {} that are selected have weight zero", mode);
  if (!list && kept.size() == all.size()) return list;
  return kept;
}

Region whole(const BtfShape& shape) {
  return {0, 0, shape.width, shape.height};
}

// The rectangle of the texels of positive weight.
Region positive_region(const std::vector<double>& texels, std::size_t width, const Region& within) {
  std::size_t left = within.x + within.width;
  std::size_t right = 0;
  std::size_t top = within.y + within.height;
  std::size_t bottom = 0;
  const auto each = [&](const Region& region, const auto& use) {
    for (std::size_t y = region.y; y < region.y + region.height; ++y) {
      for (std::size_t x = region.x; x < region.x + region.width; ++x) use(y, x);
    }
  };
  each(within, [&](std::size_t y, std::size_t x) {
    if (texels[y * width + x] == 0) return;
    left = std::min(left, x);
    right = std::max(right, x + 1);
    top = std::min(top, y);
    bottom = std::max(bottom, y + 1);
  });
  if (right == 0) fail_input("weights: all texels that are selected have weight zero");
  const Region region{left, top, right - left, bottom - top};
  each(region, [&](std::size_t y, std::size_t x) {
    if (texels[y * width + x] != 0) return;
    fail_input(
        "weights: the texel at row {}, column {} has weight zero amid others: what is left must be "
        "a rectangle; a small weight serves instead",
        y, x);
  });
  return region;
}

}  // namespace

Weights cosine_weights(const BtfInfo& info) {
  Weights weights;
  for (const Direction& view : info.view_directions) weights.views.push_back(cosine(view));
  if (info.quantity == Quantity::radiance) return weights;
  std::vector<double> lights;
  for (const Direction& light : info.light_directions) {
    lights.push_back(std::pow(cosine(light), 2));
  }
  if (info.layout == Layout::paired) {
    weights.views = products(weights.views, lights);
  } else {
    weights.lights = std::move(lights);
  }
  return weights;
}

Weights operator*(const Weights& a, const Weights& b) {
  return {products(a.views, b.views), products(a.lights, b.lights), products(a.texels, b.texels)};
}

Selection without_zeros(const Weights& weights, const BtfInfo& info, const Selection& selection) {
  Selection result = selection;
  result.views = positive(weights.views, selection.views, "views");
  result.lights = positive(weights.lights, selection.lights, "lights");
  if (!weights.texels.empty()) {
    const Region within = selection.region.value_or(whole(info.shape));
    const Region region = positive_region(weights.texels, info.shape.width, within);
    if (region != within) result.region = region;
  }
  return result;
}

Weights select(const Weights& weights, const BtfInfo& info, const Selection& selection) {
  Weights result;
  result.views = picked(weights.views, selection.views);
  result.lights = picked(weights.lights, selection.lights);
  if (!weights.texels.empty()) {
    const Region region = selection.region.value_or(whole(info.shape));
    std::vector<float> texels;
    for (std::size_t y = region.y; y < region.y + region.height; ++y) {
      for (std::size_t x = region.x; x < region.x + region.width; ++x) {
        const double weight = weights.texels.at(y * info.shape.width + x);
        if (selection.level == 0) result.texels.push_back(weight);
        texels.push_back(static_cast<float>(weight));
      }
    }
    if (selection.level > 0) {
      texels.resize(average_mip(texels, region.height, region.width, 1, selection.level));
      result.texels.assign(texels.begin(), texels.end());
    }
  }
  normalise(result.views, "views");
  normalise(result.lights, "lights");
  normalise(result.texels, "texels");
  return result;
}

Weights square_roots(const Weights& weights) {
  Weights roots = weights;
  for (std::vector<double>* list : {&roots.views, &roots.lights, &roots.texels}) {
    for (double& weight : *list) weight = std::sqrt(weight);
  }
  return roots;
}

std::optional<RowsAndColumns> rows_and_columns(const std::vector<double>& texels,
                                               std::size_t height, std::size_t width) {
  if (texels.empty()) return RowsAndColumns{};
  RowsAndColumns result;
  for (std::size_t y = 0; y < height; ++y) result.first.push_back(texels[y * width]);
  for (std::size_t x = 0; x < width; ++x) result.second.push_back(texels[x] / texels[0]);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      const double weight = texels[y * width + x];
      if (std::abs(weight - result.first[y] * result.second[x]) > 1e-6 * weight) return {};
    }
  }
  return result;
}

}  // namespace weft
