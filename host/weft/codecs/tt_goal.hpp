// What a tensor train is to reach, and the ranks that do.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "weft/codecs/codec.hpp"
#include "weft/codecs/fit_goal.hpp"
#include "weft/codecs/fit_tt.hpp"
#include "weft/job.hpp"
#include "weft/model/tensor_train.hpp"

namespace weft {

struct TtOptions {
  ModeOrder order{Mode::column, Mode::row, Mode::channel, Mode::view, Mode::light};
  bool choose_order = false;
  reference::BondRanks ranks{};  // 0 where a goal decides
  FitGoal goal;
};

// Throws input errors for parameters that make no sense, and for ranks beyond what the shape has.
TtOptions tt_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source);

// The order in which a train of a part of the source takes the fewest numbers at the goal's error
// (0.1 where there is none), reckoned with the sizes of the whole; says so in job.notes.
ModeOrder choose_order(Device& device, TileSource& source, const TtOptions& options, Job& job);

// Fits a train to what is asked; called with a request, and with a larger one again where it has to
// be.
using FitTrain = std::function<TrainFit(const reference::TrainRequest& request)>;
// The relative error of a model as it is stored.
using MeasureTrain = std::function<double(const TtModel& model)>;

// A model that meets the options' goal:
//
//   ranks  the fit of those ranks, all cores as `storage` says
//   rel    a fit whose truncation leaves room for the rounding to half; cores whose rounding does
//   not
//          fit in stay float; the stored model's error is measured, and what misses the goal is
//          fitted again, more tightly
std::unique_ptr<TtModel> fit_to_goal(const TtOptions& options, const BtfInfo& source,
                                     Storage storage, const FitTrain& fit,
                                     const MeasureTrain& measure, Job& job);

// A fit of at least `coefficients` numbers, unless arithmetic or the data hold no more; `fits`
// counts those that it took.
TrainFit fit_beyond(double coefficients, const FitTrain& fit, std::size_t& fits, Job& job);

// Ranks of ever fewer numbers, each at least 1, from the train's own on: always that direction is
// dropped that holds the least energy for the numbers it takes.
struct TrainCut {
  reference::BondRanks ranks{};
  std::size_t coefficients = 0;
  double lost = 0;  // bound of |T - T'|^2
};
std::vector<TrainCut> train_cuts(const TensorTrain& train);

// What a model's info says of it.
void describe(TtModel& model, const TtOptions& options);

}  // namespace weft
