#include "weft/codecs/nested_train.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace weft {
namespace {

class NestedTrainModels final : public NestedModels {
 public:
  explicit NestedTrainModels(NestedTrain train)
      : made_(std::move(train)), cuts_(train_cuts(made_.fit.train)) {
    std::reverse(cuts_.begin(), cuts_.end());
  }

  std::size_t count() const override { return cuts_.size(); }

  std::unique_ptr<Model> model(std::size_t i) const override {
    reference::TrainRequest request;
    request.ranks = cuts_[i].ranks;
    std::unique_ptr<TtModel> model =
        store_train(reference::tt_round(made_.fit.train, request).train, made_.options.order,
                    made_.info, Storage::f32, 0);
    model->info.storage = made_.storage;
    model->stored.fill(made_.storage);
    describe(*model, made_.options);
    return model;
  }

  std::size_t values(std::size_t i) const override { return cuts_[i].coefficients; }
  double error(std::size_t i) const override {
    const double cut = made_.fit.squares > 0 ? cuts_[i].lost / made_.fit.squares : 0;
    return std::sqrt(made_.fit.lost + cut);
  }
  bool complete() const override { return made_.complete; }
  std::string bound() const override { return made_.bound; }
  std::size_t decompositions() const override { return made_.decompositions; }

 private:
  NestedTrain made_;
  std::vector<TrainCut> cuts_;
};

}  // namespace

std::unique_ptr<NestedModels> nested_train(NestedTrain train) {
  return std::make_unique<NestedTrainModels>(std::move(train));
}

std::unique_ptr<NestedModels> nested_train(const TtOptions& options, const BtfInfo& info,
                                           const NestedRequest& request, const FitTrain& fit,
                                           Job& job) {
  // Ranks cut back from a larger train by their energy are better than those of equal errors.
  constexpr double of_error = 0.7;
  constexpr double of_values = 1.6;
  constexpr double loosest = 0.999;
  NestedTrain train;
  train.options = options;
  train.info = info;
  train.storage = request.storage;
  if (options.ranks[0] > 0) {
    reference::TrainRequest given;
    given.ranks = options.ranks;
    train.fit = fit(given);
    train.complete = true;
    train.bound = fmt::format("the ranks given, {},{},{},{}", options.ranks[0], options.ranks[1],
                              options.ranks[2], options.ranks[3]);
  } else if (request.relative > 0) {
    reference::TrainRequest wanted;
    wanted.tolerance = std::min(of_error * request.relative, loosest);
    train.fit = fit(wanted);
  } else {
    train.decompositions = 0;
    train.fit = fit_beyond(of_values * request.growth * static_cast<double>(request.values), fit,
                           train.decompositions, job);
  }
  return nested_train(std::move(train));
}

}  // namespace weft
