// Nested models of a tensor train: its ranks cut back direction by direction (train_cuts), each
// model by TT-rounding of the whole train.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/codecs/nested_models.hpp"
#include "weft/codecs/tt_goal.hpp"

namespace weft {

struct NestedTrain {
  TrainFit fit;
  TtOptions options;  // that it was made with
  BtfInfo info;
  Storage storage = Storage::f16;
  std::size_t decompositions = 1;
  bool complete = false;  // see NestedModels
  std::string bound;
};

std::unique_ptr<NestedModels> nested_train(NestedTrain train);

// By a fit as fit_to_goal takes it, as far as the request asks, within the ranks of the options.
std::unique_ptr<NestedModels> nested_train(const TtOptions& options, const BtfInfo& info,
                                           const NestedRequest& request, const FitTrain& fit,
                                           Job& job);

}  // namespace weft
