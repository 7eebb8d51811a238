#include "weft/codecs/vq_levels.hpp"

#include <utility>

#include "weft/btf/adapt.hpp"
#include "weft/btf/selection.hpp"
#include "weft/codecs/colour_source.hpp"

namespace weft {

VqLevels::VqLevels(TileSource& source, std::size_t count, bool nan_zero) : sources_{&source} {
  const auto* transformed = dynamic_cast<const TransformedSource*>(&source);
  TileSource& stored = transformed ? transformed->original() : source;
  // not to be deleted with the levels
  std::shared_ptr<TileSource> finest(std::shared_ptr<void>(), &stored);
  if (nan_zero && count > 1) finest = with_finite_values(std::move(finest));
  for (std::size_t level = 1; level < count; ++level) {
    Selection selection;
    selection.level = level;
    kept_.push_back(select(finest, selection));
    if (transformed) {
      kept_.push_back(
          std::make_shared<TransformedSource>(*kept_.back(), transformed->transform(), nan_zero));
    }
    sources_.push_back(kept_.back().get());
  }
}

void VqLevels::take(std::vector<VqCodeBook>& indices, std::size_t first, VqModel& model) const {
  model.p6 = std::move(indices[first]);
  model.coarser.clear();
  for (std::size_t level = 1; level < sources_.size(); ++level) {
    model.coarser.push_back(std::move(indices[first + level]));
  }
}

}  // namespace weft
