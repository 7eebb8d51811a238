#include "weft/codecs/least_error.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace weft {
namespace {

constexpr double first_stride = 1.4;  // between numbers of models, outwards
constexpr double near = 1.2;          // models whose numbers differ by less are not told apart
constexpr std::size_t halvings = 3;   // of the distances to the models beside the least

class Search {
 public:
  Search(const NestedModels& models, const ErrorOfModel& error) : models_(models), error_(error) {}

  std::size_t run(std::size_t start) {
    best_ = start;
    while (best_ > 0 && !std::isfinite(error(best_))) {
      best_ = std::min(best_ - 1, last_within(models_, values(best_) / 2));
    }
    if (!std::isfinite(error(best_))) return best_;
    const std::size_t last = models_.count() - 1;
    double stride = first_stride;  // ever longer
    const auto larger = [&] {
      return std::max(best_ + 1, last_within(models_, values(best_) * stride));
    };
    const auto smaller = [&] {
      return std::min(best_ - 1, last_within(models_, values(best_) / stride));
    };
    while (best_ < last && take(larger())) stride *= first_stride;
    if (stride == first_stride) {
      while (best_ > 0 && take(smaller())) stride *= first_stride;
    }
    for (std::size_t i = 0; i < halvings; ++i) {
      const std::size_t centre = best_;
      const auto found = known_.find(centre);
      if (std::next(found) != known_.end() && take_between(centre, std::next(found)->first))
        continue;
      if (found != known_.begin()) take_between(std::prev(found)->first, centre);
    }
    return best_;
  }

 private:
  double values(std::size_t i) const { return static_cast<double>(models_.values(i)); }

  double error(std::size_t i) {
    const auto [found, made] = known_.try_emplace(i, 0.0);
    if (made) found->second = error_(i);
    return found->second;
  }

  // Whether model i is better than the best so far, which it then is.
  bool take(std::size_t i) {
    if (!(error(i) < error(best_))) return false;
    best_ = i;
    return true;
  }

  bool take_between(std::size_t low, std::size_t high) {
    if (high - low < 2 || values(high) < near * values(low)) return false;
    const double middle = std::sqrt(values(low) * values(high));
    return take(std::clamp(last_within(models_, middle), low + 1, high - 1));
  }

  const NestedModels& models_;
  const ErrorOfModel& error_;
  std::map<std::size_t, double> known_;
  std::size_t best_ = 0;
};

}  // namespace

std::size_t last_within(const NestedModels& models, double values) {
  std::size_t low = 0;
  std::size_t high = models.count();
  while (low + 1 < high) {
    const std::size_t middle = low + (high - low) / 2;
    if (static_cast<double>(models.values(middle)) <= values) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

std::size_t least_error(const NestedModels& models, std::size_t start, const ErrorOfModel& error) {
  return Search(models, error).run(start);
}

}  // namespace weft
