#include "weft/reference/enlarge_vq.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace weft::reference {
namespace {

// Up to three indices, spread over `count`.
std::vector<std::size_t> spread(std::size_t count) {
  if (count < 3) return count == 1 ? std::vector<std::size_t>{0} : std::vector<std::size_t>{0, 1};
  return {0, count / 2, count - 1};
}

// The values of all texels in some pairs of directions, [P][pairs C].
std::vector<float> features_of(const VqModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t values = 1 + model.chromaticities;
  std::vector<VqPlace> places;
  for (const std::size_t view : spread(shape.views)) {
    for (const std::size_t light : spread(shape.lights)) {
      places.push_back(vq_place(model.grid, model.info.btf, view, light));
    }
  }
  const std::size_t row = places.size() * values;
  std::vector<double> entries(model.sizes.p4 * row);
  for (std::size_t j = 0; j < model.sizes.p4; ++j) {
    for (std::size_t n = 0; n < places.size(); ++n) {
      model.entry_values(j, places[n], std::span(entries).subspan(j * row + n * values, values));
    }
  }
  std::vector<float> features(shape.texels() * row);
  double largest = 0;
  for (const double value : entries) largest = std::max(largest, std::abs(value));
  for (const float scale : model.p6.scales) largest = std::max(largest, std::abs(double{scale}));
  // squares stay within float: luminances are products of two
  const double unit = largest > 0 ? 1 / largest : 1;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const double entry = unit * entries[model.p6.entries[i / row] * row + i % row];
    const double scale = i % values == 0 ? unit * double{model.p6.scales[i / row]} : unit;
    features[i] = static_cast<float>(entry * scale);
  }
  return features;
}

}  // namespace

std::unique_ptr<VqModel> enlarge(const VqModel& model, const PatchRequest& request) {
  const BtfShape& shape = model.info.btf.shape;
  const std::vector<std::size_t> texels =
      synthesise_patches(shape.height, shape.width, features_of(model), request);
  auto large = std::make_unique<VqModel>(model);
  std::vector<std::uint32_t> entries;
  large->p6.scales.clear();
  large->coarser.clear();
  for (const std::size_t p : texels) {
    entries.push_back(model.p6.entries[p]);
    large->p6.scales.push_back(model.p6.scales[p]);
  }
  large->p6.entries = PackedIndices(std::move(entries), model.sizes.p4);
  ModelInfo& info = large->info;
  info.btf.shape.height = request.height;
  info.btf.shape.width = request.width;
  info.errors.reset();
  info.selection = "{}";
  info.btf.mask.clear();
  info.btf.mask_distance.clear();
  for (std::size_t v = 0; v < shape.views && !model.info.btf.mask.empty(); ++v) {
    for (const std::size_t p : texels) {
      info.btf.mask.push_back(model.info.btf.mask[v * shape.texels() + p]);
    }
  }
  return large;
}

}  // namespace weft::reference
