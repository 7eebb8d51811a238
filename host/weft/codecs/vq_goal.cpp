#include "weft/codecs/vq_goal.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "weft/error.hpp"
#include "weft/model/model_file.hpp"

namespace weft {
namespace {

constexpr std::size_t most_fits = 16;
// Factors this near to each other give models that hardly differ.
constexpr double near = 1.02;
// Beyond, one code-vector stands for everything; below, every vector for itself.
constexpr double largest_factor = 100;
constexpr double smallest_factor = 1e-5;

// A model for a goal, as the search goes through factors. Larger ones give larger errors and
// smaller files, as a rule.
class GoalSearch {
 public:
  GoalSearch(const FitGoal& goal, double least, const VqGoalSteps& steps, Job& job)
      : goal_(goal), least_(least), steps_(steps), job_(job) {}

  std::unique_ptr<VqModel> run() {
    const bool by_size = goal_.kind == FitGoal::Kind::size;
    double factor = std::max(by_size ? 0.1 : 2 * goal_.relative, least_);
    for (std::size_t fit = 0; fit < most_fits; ++fit) {
      const bool met = try_factor(factor);
      if (met_ && missed_) {
        const double low = std::min(*met_, *missed_);
        const double high = std::max(*met_, *missed_);
        if (high <= near * low) break;
        factor = std::sqrt(low * high);
        continue;
      }
      // outwards: towards larger ones after an error that is small enough, and after a size that
      // is not
      const bool upwards = met != by_size;
      if (upwards ? factor >= largest_factor : factor <= std::max(least_, smallest_factor)) break;
      factor = upwards ? std::min(factor * step_, largest_factor)
                       : std::max(factor / step_, std::max(least_, smallest_factor));
      step_ *= 1.5;
    }
    // every vector its own, where nothing else is exact enough
    if (!model_ && !by_size && least_ == 0) try_factor(0);
    if (!model_ && by_size) {
      fail(ErrorKind::unmet_goal,
           "--target {}: code-books of thresholds of {:.4g} take {} bytes, {} are allowed",
           goal_.text, *missed_, smallest_size_, goal_.bytes);
    }
    if (!model_) {
      fail(ErrorKind::unmet_goal,
           "--target {}: {:.4g} was reached, with thresholds of {:.4g}; more --slices or --samples "
           "may reach more",
           goal_.text, least_error_, *missed_);
    }
    return std::move(model_);
  }

 private:
  // Whether the model of this factor meets the goal; the best of those that do is kept.
  bool try_factor(double factor) {
    std::unique_ptr<VqModel> model = steps_.fit(factor);
    const std::size_t bytes = model_file_size(*model);
    bool met = bytes <= goal_.bytes;
    smallest_size_ = std::min(smallest_size_, bytes);
    if (goal_.kind == FitGoal::Kind::relative) {
      const double error = steps_.relative_error(*model);
      job_.notes.push_back(fmt::format("thresholds of {:.4g}: relative error {:.4g}, {} bytes",
                                       factor, error, bytes));
      least_error_ = std::min(least_error_, error);
      // written so that an error that is no number, of data that is all zero, is small enough
      met = !(error > goal_.relative);
    } else {
      job_.notes.push_back(fmt::format("thresholds of {:.4g}: {} bytes", factor, bytes));
    }
    std::optional<double>& side = met ? met_ : missed_;
    side = factor;
    if (met) model_ = std::move(model);
    return met;
  }

  const FitGoal& goal_;
  double least_;
  const VqGoalSteps& steps_;
  Job& job_;
  double step_ = 1.5;
  std::optional<double> met_, missed_;
  std::unique_ptr<VqModel> model_;
  double least_error_ = std::numeric_limits<double>::infinity();
  std::size_t smallest_size_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace

std::unique_ptr<VqModel> meet_vq_goal(const FitGoal& goal, double least, const VqGoalSteps& steps,
                                      Job& job) {
  return GoalSearch(goal, least, steps, job).run();
}

}  // namespace weft
