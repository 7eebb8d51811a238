// Goals of mixtures of clusters: a model that is cut of a larger fit is not the best of its ranks,
// since clusters that are mixed can make up for what their neighbours lose. So the cut model is
// fitted again from its own clusters on, in the space that the larger fit was made in, and the
// models of the goal are cut of that.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "weft/codecs/nested_models.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

// The models of a fit, which is one of so many.
using NestKcta = std::function<std::unique_ptr<NestedModels>(KctaFit fit, std::size_t fits)>;

// Those of the fit of least size that meets the request, of some, or a little more than its size;
// those of `whole`, the encoder's fit, where no smaller one does.
std::unique_ptr<NestedModels> refitted(std::unique_ptr<NestedModels> whole, KctaEncoder& encoder,
                                       const NestedRequest& request, std::size_t iterations,
                                       const NestKcta& nest);

}  // namespace weft
