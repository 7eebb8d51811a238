#include "tune/search.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "bench/measure.hpp"
#include "weft/device/tuning.hpp"
#include "weft/error.hpp"
#include "weft/reference/random.hpp"

namespace weft {
namespace {

constexpr std::size_t small_grid = 64;    // candidates that are all visited
constexpr std::size_t rounds = 3;         // of a candidate beside the base
constexpr std::size_t last_rounds = 15;   // of the best beside the base
constexpr double share_of_search = 0.75;  // of the budget; the rest is for the last comparison
constexpr double hopeless = 1.4;     // of the base's time: such a candidate gets no further round
constexpr double least_gain = 0.01;  // relative
constexpr std::size_t told_rejections = 8;

// Seeded whole numbers below a bound.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : seed_(seed) {}
  std::size_t below(std::size_t bound) { return reference::splitmix64(seed_, next_++) % bound; }
  template <typename T>
  void shuffle(std::vector<T>& items) {
    for (std::size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[below(i)]);
  }

 private:
  std::uint64_t seed_;
  std::uint64_t next_ = 0;
};

// Combinations of legal values, by number: the first macro counts fastest.
class Grid {
 public:
  Grid(const TunableKernel& kernel, const DeviceLimits& limits) : kernel_(kernel), limits_(limits) {
    for (const Tunable& macro : kernel.macros) size_ *= macro.legal.size();
  }
  std::size_t size() const { return size_; }
  TuneValues at(std::size_t number) const {
    TuneValues values;
    for (const Tunable& macro : kernel_.macros) {
      values.push_back(macro.legal.begin()[number % macro.legal.size()]);
      number /= macro.legal.size();
    }
    return values;
  }
  bool suits(const TuneValues& values) const { return refusal(kernel_, values, limits_).empty(); }
  std::vector<TuneValues> all() const {
    std::vector<TuneValues> list;
    for (std::size_t number = 0; number < size_; ++number) {
      TuneValues values = at(number);
      if (suits(values)) list.push_back(std::move(values));
    }
    return list;
  }
  // One macro one step away.
  std::vector<TuneValues> neighbours(const TuneValues& values) const {
    std::vector<TuneValues> list;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const LegalValues& legal = kernel_.macros[i].legal;
      const auto* here = std::find(legal.begin(), legal.end(), values[i]);
      if (here == legal.end()) continue;
      TuneValues other = values;
      if (here != legal.begin()) {
        other[i] = here[-1];
        if (suits(other)) list.push_back(other);
      }
      if (here + 1 != legal.end()) {
        other[i] = here[1];
        if (suits(other)) list.push_back(other);
      }
    }
    return list;
  }

 private:
  const TunableKernel& kernel_;
  const DeviceLimits& limits_;
  std::size_t size_ = 1;
};

class Search {
 public:
  Search(const TunableKernel& kernel, const DeviceLimits& limits, const TuneValues& base,
         TuneWork& work, const TuneOptions& options)
      : kernel_(kernel),
        grid_(kernel, limits),
        base_(base),
        work_(work),
        options_(options),
        draws_(options.seed),
        begin_(work.now()) {
    // a grid that would take long to count is not counted
    outcome_.legal = grid_.size() <= 1000000 ? grid_.all().size() : grid_.size();
    outcome_.best = base;
  }

  TuneOutcome run(const std::vector<TuneValues>& first) {
    const std::string wrong = work_.check(base_);
    if (!wrong.empty()) {
      fail_runtime("kernel {} with {}: {}", kernel_.name, format_values(kernel_, base_), wrong);
    }
    work_.time(base_);  // warms the caches
    visited_.insert(base_);
    outcome_.tried = 1;
    for (const TuneValues& values : first) visit(values);
    if (grid_.size() <= small_grid) {
      std::vector<TuneValues> all = grid_.all();
      draws_.shuffle(all);
      for (const TuneValues& values : all) visit(values);
    } else {
      climb();
      while (!over() && visited_.size() < outcome_.legal) {
        sample(small_grid / 4);
        climb();
      }
    }
    confirm();
    return std::move(outcome_);
  }

 private:
  double elapsed() { return work_.now() - begin_; }
  bool over() { return elapsed() >= share_of_search * options_.budget; }

  // Candidates drawn at random; those seen before are passed over.
  void sample(std::size_t count) {
    std::size_t misses = 0;
    while (count > 0 && misses < 1000 && !over()) {
      const TuneValues values = grid_.at(draws_.below(grid_.size()));
      if (visited_.contains(values) || !grid_.suits(values)) {
        ++misses;
        continue;
      }
      visit(values);
      --count;
    }
    if (misses == 1000) exhausted_ = true;
  }

  // From the best to its neighbours as long as one is better.
  void climb() {
    bool better = true;
    while (better && !over()) {
      better = false;
      std::vector<TuneValues> list = grid_.neighbours(outcome_.best);
      draws_.shuffle(list);
      for (const TuneValues& values : list) better |= visit(values);
    }
    if (exhausted_) {  // hardly anything is left: see the rest in order
      for (const TuneValues& values : grid_.all()) visit(values);
    }
  }

  // Checks and times a candidate; whether it is the best so far.
  bool visit(const TuneValues& values) {
    if (over() || !visited_.insert(values).second) return false;
    ++outcome_.tried;
    if (options_.progress) options_.progress(outcome_.tried, outcome_.legal);
    const std::optional<double> ratio = ratio_to_base(values);
    if (!ratio || *ratio >= best_ratio_) return false;
    best_ratio_ = *ratio;
    outcome_.best = values;
    return true;
  }

  // The median of candidate / base; nothing if the candidate is wrong or fails.
  std::optional<double> ratio_to_base(const TuneValues& values) {
    try {
      const std::string wrong = work_.check(values);
      if (!wrong.empty()) {
        reject(values, wrong);
        return std::nullopt;
      }
      work_.time(values);
      std::vector<double> ratios;
      for (std::size_t round = 0; round < rounds; ++round) {
        const double base = work_.time(base_);
        ratios.push_back(work_.time(values) / base);
        if (ratios.back() > hopeless) break;
      }
      return median(ratios);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::runtime && error.kind() != ErrorKind::input) throw;
      reject(values, error.what());
      return std::nullopt;
    }
  }

  void reject(const TuneValues& values, const std::string& reason) {
    ++outcome_.rejected;
    if (outcome_.rejections.size() == told_rejections) return;
    const std::string line = reason.substr(0, reason.find('\n'));
    outcome_.rejections.push_back(fmt::format("{}: {}", format_values(kernel_, values), line));
  }

  // The best against the base, many times; the base stays unless the gain is more than noise.
  void confirm() {
    const TuneValues candidate = outcome_.best;
    outcome_.best = base_;
    if (candidate == base_) {
      outcome_.base_seconds = outcome_.best_seconds = work_.time(base_);
      return;
    }
    std::vector<double> of_base, of_best, ratios;
    while (ratios.size() < rounds || (ratios.size() < last_rounds && elapsed() < options_.budget)) {
      of_base.push_back(work_.time(base_));
      of_best.push_back(work_.time(candidate));
      ratios.push_back(of_best.back() / of_base.back());
    }
    std::ranges::sort(ratios);
    const double middle = median(ratios);
    const double lower = ratios[ratios.size() / 4];
    const double upper = ratios[ratios.size() - 1 - ratios.size() / 4];
    outcome_.compared = true;
    outcome_.noise = (upper - lower) / 2;
    outcome_.base_seconds = median(of_base);
    outcome_.best_seconds = median(of_best);
    outcome_.improved = middle + std::max(least_gain, outcome_.noise) < 1.0;
    if (outcome_.improved) outcome_.best = candidate;
  }

  const TunableKernel& kernel_;
  Grid grid_;
  TuneValues base_;
  TuneWork& work_;
  const TuneOptions& options_;
  Draws draws_;
  double begin_;
  TuneOutcome outcome_;
  std::set<TuneValues> visited_;
  double best_ratio_ = 1.0;
  bool exhausted_ = false;
};

}  // namespace

TuneOutcome tune_kernel(const TunableKernel& kernel, const DeviceLimits& limits,
                        const TuneValues& base, const std::vector<TuneValues>& first,
                        TuneWork& work, const TuneOptions& options) {
  return Search(kernel, limits, base, work, options).run(first);
}

}  // namespace weft
