// The search for thresholds of `vq` that meet a goal: the largest by which the error is small
// enough, or the smallest by which the file is. All levels' thresholds grow together; models are
// fitted until one that meets the goal and one that misses it are near each other.
#pragma once

#include <functional>
#include <memory>

#include "weft/codecs/fit_goal.hpp"
#include "weft/job.hpp"
#include "weft/model/vq.hpp"

namespace weft {

// Which factors are looked at.
struct FactorSearch {
  bool by_size = false;  // the smallest that meets the goal is wanted, else the largest
  double first = 1;
  double least = 0;
};
// Calls met(factor) until one that meets the goal and one that misses it are near each other. The
// last one that met it is the one that is wanted.
void search_factor(const FactorSearch& search, const std::function<bool(double factor)>& met);

struct VqGoalSteps {
  // A model as it is stored, of thresholds times a factor.
  std::function<std::unique_ptr<VqModel>(double factor)> fit;
  // Its relative error against what it was fitted to.
  std::function<double(const VqModel& model)> relative_error;
};

// Factors are at least `least`. Throws the unmet goal, with what was reached.
std::unique_ptr<VqModel> meet_vq_goal(const FitGoal& goal, double least, const VqGoalSteps& steps,
                                      Job& job);

}  // namespace weft
