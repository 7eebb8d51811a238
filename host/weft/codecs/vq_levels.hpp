// The mip levels of what `vq` fits (Havran et al. 2010, section 5.1.3): averages of what the source
// stores, to which its colour transform is applied then.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/reference/vq_joint_fit.hpp"

namespace weft {

class VqLevels {
 public:
  // `source`, which must outlive it, and the `count` - 1 levels that follow.
  VqLevels(TileSource& source, std::size_t count, bool nan_zero);

  const VqSources& sources() const { return sources_; }
  // Gives a model the planar indices of these sources, from the index `first` on.
  void take(std::vector<VqCodeBook>& indices, std::size_t first, VqModel& model) const;

 private:
  VqSources sources_;
  std::vector<std::shared_ptr<TileSource>> kept_;
};

}  // namespace weft
