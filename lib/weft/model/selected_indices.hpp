// What a selection keeps of a model, for models that select by copying.
#pragma once

#include <cstddef>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/model/model.hpp"

namespace weft {

struct SelectedIndices {
  std::vector<std::size_t> views;
  std::vector<std::size_t> lights;
  std::vector<std::size_t> channels;
  std::vector<std::size_t> texels;  // p = y X + x of the whole, row by row of the region

  // Rows (v, l, c) of the whole, in the order of the part.
  std::vector<std::size_t> image_channels(const BtfShape& whole) const;
};

// The selection must fit the shape; its mip level is not looked at.
SelectedIndices selected_indices(const BtfShape& whole, const Selection& selection);

// What the part knows of itself: what it decodes to, what of the BTF that is, and no errors, which
// were measured of the whole. Throws an input error if the model's record of what it holds does not
// fit what it decodes to.
ModelInfo selected_info(const ModelInfo& whole, const Selection& selection);

}  // namespace weft
