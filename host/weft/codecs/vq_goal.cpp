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

// A model for a goal, as the search goes through factors.
class GoalSearch {
 public:
  GoalSearch(const FitGoal& goal, double least, const VqGoalSteps& steps, Job& job)
      : goal_(goal), least_(least), steps_(steps), job_(job) {}

  std::unique_ptr<VqModel> run() {
    const bool by_size = goal_.kind == FitGoal::Kind::size;
    const FactorSearch search{by_size, by_size ? 0.1 : 2 * goal_.relative, least_};
    search_factor(search, [&](double factor) { return try_factor(factor); });
    if (!model_ && by_size) {
      fail(ErrorKind::unmet_goal,
           "--target {}: code-books of thresholds of {:.4g} take {} bytes, {} are allowed",
           goal_.text, tried_, smallest_size_, goal_.bytes);
    }
    if (!model_) {
      fail(ErrorKind::unmet_goal,
           "--target {}: {:.4g} was reached, with thresholds of {:.4g}; more --slices or --samples "
           "may reach more",
           goal_.text, least_error_, tried_);
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
    tried_ = factor;
    if (met) model_ = std::move(model);
    return met;
  }

  const FitGoal& goal_;
  double least_;
  const VqGoalSteps& steps_;
  Job& job_;
  double tried_ = 0;
  std::unique_ptr<VqModel> model_;
  double least_error_ = std::numeric_limits<double>::infinity();
  std::size_t smallest_size_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace

// Larger factors give larger errors and smaller files, as a rule.
void search_factor(const FactorSearch& search, const std::function<bool(double factor)>& met) {
  const double least = std::max(search.least, smallest_factor);
  double factor = std::max(search.first, search.least);
  double step = 1.5;
  std::optional<double> meets, misses;
  for (std::size_t fit = 0; fit < most_fits; ++fit) {
    const bool meets_it = met(factor);
    (meets_it ? meets : misses) = factor;
    if (meets && misses) {
      const double low = std::min(*meets, *misses);
      const double high = std::max(*meets, *misses);
      if (high <= near * low) break;
      factor = std::sqrt(low * high);
      continue;
    }
    // outwards: towards larger ones after an error that is small enough, and after a size that is
    // not
    const bool upwards = meets_it != search.by_size;
    if (upwards ? factor >= largest_factor : factor <= least) break;
    factor = upwards ? std::min(factor * step, largest_factor) : std::max(factor / step, least);
    step *= 1.5;
  }
  // every vector its own, where nothing else is exact enough
  if (!meets && !search.by_size && search.least == 0) met(0);
}

std::unique_ptr<VqModel> meet_vq_goal(const FitGoal& goal, double least, const VqGoalSteps& steps,
                                      Job& job) {
  return GoalSearch(goal, least, steps, job).run();
}

}  // namespace weft
