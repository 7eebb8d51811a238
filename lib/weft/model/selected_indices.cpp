#include "weft/model/selected_indices.hpp"

#include <numeric>

#include "weft/btf/recorded_selection.hpp"

namespace weft {
namespace {

std::vector<std::size_t> all_indices(std::size_t count) {
  std::vector<std::size_t> indices(count);
  std::iota(indices.begin(), indices.end(), std::size_t{0});
  return indices;
}

}  // namespace

std::vector<std::size_t> SelectedIndices::image_channels(const BtfShape& whole) const {
  std::vector<std::size_t> rows;
  rows.reserve(views.size() * lights.size() * channels.size());
  for (const std::size_t v : views) {
    for (const std::size_t l : lights) {
      for (const std::size_t c : channels) {
        rows.push_back((v * whole.lights + l) * whole.channels + c);
      }
    }
  }
  return rows;
}

SelectedIndices selected_indices(const BtfShape& whole, const Selection& selection) {
  SelectedIndices indices;
  indices.views = selection.views.value_or(all_indices(whole.views));
  indices.lights = selection.lights.value_or(all_indices(whole.lights));
  indices.channels = selection.channels.value_or(all_indices(whole.channels));
  const Region region = selection.region.value_or(Region{0, 0, whole.width, whole.height});
  indices.texels.reserve(region.width * region.height);
  for (std::size_t y = region.y; y < region.y + region.height; ++y) {
    for (std::size_t x = region.x; x < region.x + region.width; ++x) {
      indices.texels.push_back(y * whole.width + x);
    }
  }
  return indices;
}

ModelInfo selected_info(const ModelInfo& whole, const Selection& selection) {
  constexpr std::string_view where = "the model's selection";
  ModelInfo info = whole;
  info.btf = select(whole.btf, selection);
  info.selection =
      to_json(composed(whole.btf, recorded_from_json(whole.selection, where), selection, where));
  info.errors.reset();
  return info;
}

}  // namespace weft
