#include "weft/codecs/meet_goal.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "weft/codecs/least_error.hpp"
#include "weft/error.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/model_metadata.hpp"

namespace weft {
namespace {

constexpr std::size_t most_rounds = 8;  // of decompositions

// What identifies a stored model's values: nested models may be equal.
std::string fingerprint(const Model& model) {
  std::string text;
  for (const ModelTensor& tensor : model.tensors()) text += checksum_of(tensor.values);
  return text;
}

class Search {
 public:
  Search(const Goal& goal, const GoalSource& source, const GoalSteps& steps, Job& job)
      : goal_(goal),
        source_(source),
        steps_(steps),
        job_(job),
        storage_(source.storage),
        held_(job.held.size()) {
    job.held.push_back({"models that are tried", 0});
  }
  ~Search() { job_.held.resize(held_); }
  Search(const Search&) = delete;
  Search& operator=(const Search&) = delete;

  GoalResult run() {
    NestedRequest request = first_request();
    std::unique_ptr<NestedModels> models = decompose(request);
    if (!models) {
      goal_.by_size() ? encode_to_size() : encode_to_error();
      return std::move(result_);
    }
    for (std::size_t round = 1; !found_in(*models); ++round) {
      if (round == most_rounds || models->complete() || exhausted_) {
        if (goal_.by_size() && result_.model) break;  // no decomposition is larger
        fail_unmet(models->bound());
      }
      enlarge(request, *models);
      request.spectra = models->spectra();
      models.reset();
      try {
        models = decompose(request);
      } catch (const Error& error) {
        // what was no error of the smaller one forbids the larger
        if (error.kind() != ErrorKind::input) throw;
        if (result_.model) break;
        fail_unmet(error.what());
      }
    }
    if (steps_.store_to_size && models) {
      decompose_nearer(request, std::move(models));
    } else if (goal_.by_size()) {
      result_.measured = steps_.measure(*result_.model);
      ++result_.trials;
    } else if (steps_.store_to_goal && models) {
      spend_on_steps(*models);
    }
    return std::move(result_);
  }

 private:
  using Clock = std::chrono::steady_clock;

  // Slightly more than is asked for: rounding takes some of it.
  static constexpr double margin = 0.99;

  double value_bytes() const { return source_.value_bytes; }
  double foreseen_relative() const {
    return goal_.relative(source_.root_mean_square, source_.peak);
  }

  NestedRequest first_request() const {
    NestedRequest request;
    request.storage = storage_;
    request.steps = steps_.store_to_goal || steps_.store_to_size;
    request.squares = source_.squares;
    if (goal_.by_size()) {
      request.values = static_cast<std::size_t>(static_cast<double>(goal_.bytes) / value_bytes());
      request.values = std::max<std::size_t>(request.values, 1);
      return request;
    }
    // of goals that do not say it: a common relative error, and a largest error of some times the
    // root of the mean square
    constexpr double common = 0.1;
    constexpr double peaks = 8;
    double relative = foreseen_relative() * margin;
    if (goal_.kind == GoalKind::ssim) relative = common;
    if (goal_.kind == GoalKind::max) {
      relative =
          source_.root_mean_square > 0 ? goal_.value / (peaks * source_.root_mean_square) : 1;
    }
    request.relative = request.wanted = std::min(relative, 1.0);
    return request;
  }

  // Whether these models hold the one that is searched for.
  bool found_in(const NestedModels& models) {
    if (!goal_.by_size()) return smallest(models);
    return steps_.store_to_size ? most_accurate(models) : largest(models);
  }

  // A decomposition or an encoder speaks of the error that it was asked for.
  template <typename Make>
  auto rephrased(double relative, const Make& make) {
    try {
      return make();
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::unmet_goal) throw;
      std::string_view text = error.what();
      const std::size_t colon = text.find(": ");
      if (text.starts_with("--") && colon != std::string_view::npos) text.remove_prefix(colon + 2);
      if (goal_.by_size()) fail(ErrorKind::unmet_goal, "--target {}: {}", goal_.text, text);
      fail(ErrorKind::unmet_goal, "--target {}, a relative error of {:.4g}: {}", goal_.text,
           relative, text);
    }
  }

  std::unique_ptr<NestedModels> decompose(const NestedRequest& request) {
    const Clock::time_point start = Clock::now();
    // A model that is tried, here and on the device, and the best so far: counted in the
    // decomposition's plan where they are foreseen, else as soon as they are known.
    const std::size_t number = 3 * sizeof(float) + source_.storing_bytes;
    job_.held[held_].bytes =
        static_cast<std::size_t>(request.growth * static_cast<double>(request.values)) * number;
    std::unique_ptr<NestedModels> models =
        rephrased(request.relative, [&] { return steps_.decompose(request); });
    if (!models) return models;
    result_.decompositions += models->decompositions();
    result_.decompose_seconds = std::chrono::duration<double>(Clock::now() - start).count();
    const std::size_t numbers = models->values(models->count() - 1);
    MemoryPlan plan;
    plan.items = job_.held;
    plan.items[held_].bytes = numbers * number;
    plan.limit = job_.memory;
    plan.add("decomposition", numbers * sizeof(float));
    plan.check();
    // storing a model has a plan of its own
    job_.held[held_].bytes = 2 * numbers * sizeof(float);
    return models;
  }

  // The request after one that came to too little.
  void enlarge(NestedRequest& request, const NestedModels& models) {
    if (steps_.store_to_size) {
      request.growth *= 2;
      return;
    }
    if (goal_.by_size()) {
      constexpr double spare = 1.05;
      const double numbers = static_cast<double>(models.values(models.count() - 1));
      const double wanted = static_cast<double>(goal_.bytes) / bytes_of_value_ * spare;
      request.growth *= std::clamp(wanted / std::max(numbers, 1.0), 1.2, 4.0);
      return;
    }
    constexpr double least_step = 0.2;
    constexpr double most_step = 0.9;
    request.relative *= std::clamp(0.95 * nearest_factor_, least_step, most_step);
    request.growth *= 2;
  }

  struct Trial {
    std::unique_ptr<Model> model;
    MeasuredModel measured;

    const ErrorReport& errors() const { return measured.errors; }
  };

  Trial measured(std::unique_ptr<Model> model) {
    const std::string key = fingerprint(*model);
    const auto known = known_.find(key);
    if (known != known_.end()) return {std::move(model), known->second};
    const MeasuredModel found = steps_.measure(*model);
    ++result_.trials;
    known_.emplace(key, found);
    return {std::move(model), found};
  }
  Trial trial(const NestedModels& models, std::size_t i) {
    std::unique_ptr<Model> model = models.model(i);
    // steps to the goal follow when ranks are known
    steps_.store_floats ? steps_.store_floats(*model) : steps_.store(*model, storage_);
    return measured(std::move(model));
  }

  // The factor by which errors are to change; what it can't be told of is far.
  double factor(const ErrorReport& errors) const {
    const double found = goal_.missing_factor(errors);
    return std::isfinite(found) && found > 0 ? found : 0.5;
  }

  // The first model with a foreseen error of at most this.
  static std::size_t first_within(const NestedModels& models, double error) {
    std::size_t low = 0;
    std::size_t high = models.count() - 1;
    while (low < high) {
      const std::size_t middle = low + (high - low) / 2;
      if (models.error(middle) <= error) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    return low;
  }

  // The smallest model that meets the goal; false where none does.
  bool smallest(const NestedModels& models) {
    const std::size_t count = models.count();
    std::size_t misses = 0;  // models before this one miss
    std::size_t meets = count;
    const double wanted = foreseen_relative();
    std::size_t at = wanted > 0 ? first_within(models, wanted) : count - 1;
    std::size_t stride = 1;
    constexpr std::size_t most_guesses = 6;  // before the middle is taken
    for (std::size_t guess = 0; misses < meets; ++guess) {
      Trial tried = trial(models, at);
      const double missing = factor(tried.errors());
      if (goal_.met(tried.errors())) {
        meets = at;
        met_ = at;
        take(std::move(tried));
      } else {
        misses = at + 1;
        if (at + 1 == count && !largest_misses(models, tried)) {
          return smallest(models);  // in float
        }
      }
      if (misses >= meets) break;
      // where the foreseen errors and this measured one say; else outwards, by ever longer strides
      const std::size_t last = std::min(meets, count) - 1;
      const std::size_t next = first_within(models, models.error(at) * missing);
      if (guess >= most_guesses) {
        at = misses + (last - misses) / 2;
      } else if (next >= misses && next <= last) {
        at = next;
      } else if (next > last) {
        at = last - std::min(stride - 1, last - misses);
        stride *= 2;
      } else {
        at = misses + std::min(stride - 1, last - misses);
        stride *= 2;
      }
    }
    return meets < count;
  }

  // What the goal leaves goes into coarser steps: of the smallest model that meets it, and of
  // larger ones while they take fewer bytes.
  void spend_on_steps(const NestedModels& models) {
    const double foreseen = models.error(met_);
    std::size_t least = file_size(*result_.model);
    std::size_t before = models.count();
    bool found = false;
    for (const double part : {0.99, 0.96, 0.92, 0.87, 0.8}) {
      const std::size_t at = std::max(first_within(models, part * foreseen), met_);
      if (at == before) continue;
      before = at;
      std::unique_ptr<Model> model = models.model(at);
      steps_.store_to_goal(*model);
      Trial tried = measured(std::move(model));
      if (!goal_.met(tried.errors())) continue;
      const std::size_t size = file_size(*tried.model);
      if (size >= least && found) break;
      if (size >= least) continue;
      least = size;
      found = true;
      take(std::move(tried));
    }
  }

  // Whether the largest model misses whatever it is stored as. Where it is mostly half that makes
  // it miss, float takes its place if it may.
  bool largest_misses(const NestedModels& models, const Trial& half) {
    const double missing = factor(half.errors());
    if (nearest_factor_ > 0 && missing < 1.01 * nearest_factor_) exhausted_ = true;
    if (missing > nearest_factor_) {
      nearest_factor_ = missing;
      result_.reached = goal_.reached(half.errors());
    }
    if (!source_.may_widen || storage_ == Storage::f32) return true;
    std::unique_ptr<Model> whole = models.model(models.count() - 1);
    steps_.store(*whole, Storage::f32);
    const double unrounded = factor(measured(std::move(whole)).errors());
    // squared errors in units of the wanted one
    const double rounding = 1 / (missing * missing) - 1 / (unrounded * unrounded);
    constexpr double most_rounding = 0.5;
    if (rounding < most_rounding) return true;
    job_.notes.push_back(fmt::format("stored as f32: f16 does not hold {}", goal_.text));
    storage_ = Storage::f32;
    exhausted_ = false;
    nearest_factor_ = 0;
    return false;
  }

  // The largest model whose file is small enough; false where none is, or where a larger
  // decomposition may give a larger one.
  bool largest(const NestedModels& models) {
    const std::size_t count = models.count();
    std::size_t fits = 0;           // models before this one fit
    std::size_t too_large = count;  // and this one, and those after it, do not
    const auto size_of = [&](std::size_t at) {
      std::unique_ptr<Model> model = models.model(at);
      steps_.store(*model, storage_);
      const std::size_t size = file_size(*model);
      if (size <= goal_.bytes) {
        fits = at + 1;
        take_by_size(std::move(model), size);
      } else {
        too_large = at;
      }
      return size;
    };
    result_.model.reset();
    smallest_size_ = size_of(0);
    if (too_large == 0) {
      exhausted_ = true;
      return false;
    }
    // Bytes grow with numbers, by how many each time tells.
    bytes_of_value_ = value_bytes();
    std::size_t at = 0;
    std::size_t size = smallest_size_;
    constexpr std::size_t most_guesses = 8;  // before the middle is taken
    for (std::size_t guess = 0; fits < too_large; ++guess) {
      const double room = (static_cast<double>(goal_.bytes) - static_cast<double>(size));
      const double wanted = static_cast<double>(models.values(at)) + room / bytes_of_value_;
      at = guess < most_guesses ? std::clamp(last_within(models, wanted), fits, too_large - 1)
                                : fits + (too_large - fits) / 2;
      size = size_of(at);
      if (models.values(at) > models.values(0) && size > smallest_size_) {
        bytes_of_value_ = static_cast<double>(size - smallest_size_) /
                          static_cast<double>(models.values(at) - models.values(0));
      }
    }
    return too_large < count || models.complete();
  }

  // The model that errs least where its steps are as fine as the size allows; false where none is
  // small enough, or where a larger decomposition may hold a better one.
  bool most_accurate(const NestedModels& models) {
    const double most = static_cast<double>(models.values(models.count() - 1));
    constexpr double larger = 1.05;
    if (most < larger * largest_values_) exhausted_ = true;
    largest_values_ = most;
    const double hoped = static_cast<double>(goal_.bytes) / value_bytes();
    const std::vector<std::string> notes = job_.notes;
    const ErrorOfModel error = [&](std::size_t i) {
      job_.notes = notes;
      std::unique_ptr<Model> model = models.model(i);
      if (!steps_.store_to_size(*model)) {
        if (i == 0) smallest_size_ = file_size(*model);
        return std::numeric_limits<double>::infinity();
      }
      Trial tried = measured(std::move(model));
      const ErrorReport& errors = tried.errors();
      const double found = errors.weighted ? errors.weighted->rmse : errors.rmse;
      if (result_.model && found >= least_error_) return found;
      least_error_ = found;
      best_values_ = static_cast<double>(models.values(i));
      best_notes_.assign(job_.notes.begin() + static_cast<std::ptrdiff_t>(notes.size()),
                         job_.notes.end());
      result_.measured = tried.measured;
      const std::size_t size = file_size(*tried.model);
      take_by_size(std::move(tried.model), size);
      return found;
    };
    const std::size_t best =
        least_error(models, last_within(models, best_values_ > 0 ? best_values_ : hoped), error);
    job_.notes = notes;
    if (!result_.model) {
      exhausted_ = true;
      return false;
    }
    return best + 1 < models.count() || models.complete() || exhausted_;
  }

  // Where cuts lose more than they have to, those of decompositions of ever fewer numbers are tried
  // too, unless larger ones came to more.
  void decompose_nearer(NestedRequest request, std::unique_ptr<NestedModels> models) {
    while (models->cuts_lose() && request.growth <= 1) {
      const double before = least_error_;
      request.growth /= 2;
      request.spectra = models->spectra();
      models.reset();
      models = decompose(request);
      (void)most_accurate(*models);
      if (least_error_ >= before) break;
    }
    job_.notes.insert(job_.notes.end(), best_notes_.begin(), best_notes_.end());
  }

  // Of a model whose errors are not measured yet.
  std::size_t file_size(Model& model) { return sizer().size_with_errors(model); }
  FileSizer& sizer() { return steps_.sizer ? *steps_.sizer : own_sizer_; }

  void take(Trial trial) {
    result_.model = std::move(trial.model);
    result_.measured = trial.measured;
    result_.reached = goal_.reached(trial.errors());
  }

  void take_by_size(std::unique_ptr<Model> model, std::size_t size) {
    result_.model = std::move(model);
    result_.reached = static_cast<double>(size);
    if (goal_.kind == GoalKind::ratio) {
      result_.reached = static_cast<double>(source_.bytes) / static_cast<double>(size);
    }
  }

  // The codec's own search for a relative error, of which the goal's is one, or is not far.
  void encode_to_error() {
    double relative = first_request().relative;
    if (goal_.kind != GoalKind::ssim && goal_.kind != GoalKind::max) relative /= margin;
    constexpr double near = 0.977;  // 0.2 dB
    constexpr double loosest = 0.999;
    bool met = false;
    for (std::size_t round = 0; round < most_rounds; ++round) {
      relative = std::min(relative, loosest);
      Trial tried = encoded(relative);
      const bool meets = goal_.met(tried.errors());
      const double missing = factor(tried.errors());
      const bool better = meets && (!met || file_size(*tried.model) < file_size(*result_.model));
      if (!met && !meets) result_.reached = goal_.reached(tried.errors());
      if (better) take(std::move(tried));
      const bool coarsest = meets && relative == loosest;
      if (meets && (met || missing * near <= 1 || coarsest)) return;
      if (met && !meets) return;
      met = met || meets;
      // what was asked for is what the codec comes near to from below
      relative *= meets ? missing : std::min(0.98 * missing, 0.98);
    }
    if (!met) fail_unmet("as much as its own search finds");
  }

  // The same for a size.
  void encode_to_size() {
    double bytes = static_cast<double>(goal_.bytes);
    for (std::size_t round = 0; round < most_rounds; ++round) {
      std::unique_ptr<Model> model = rephrased(0, [&] {
        ++result_.decompositions;
        return steps_.encode(fmt::format("size={:.0f}", bytes));
      });
      steps_.store(*model, storage_);
      const std::size_t size = file_size(*model);
      if (size <= goal_.bytes) {
        result_.measured = steps_.measure(*model);
        ++result_.trials;
        take_by_size(std::move(model), size);
        return;
      }
      smallest_size_ = size;
      bytes -= static_cast<double>(size - goal_.bytes);
      if (bytes < 1) break;
    }
    fail_unmet("as much as its own search finds");
  }

  Trial encoded(double relative) {
    const Clock::time_point start = Clock::now();
    std::unique_ptr<Model> model =
        rephrased(relative, [&] { return steps_.encode(fmt::format("rel={}", relative)); });
    ++result_.decompositions;
    result_.decompose_seconds = std::chrono::duration<double>(Clock::now() - start).count();
    steps_.store(*model, model->info.storage);
    return measured(std::move(model));
  }

  [[noreturn]] void fail_unmet(const std::string& bound) const {
    if (goal_.by_size()) {
      fail(ErrorKind::unmet_goal,
           "--target {}: the smallest model is a file of {} bytes, {} are "
           "allowed",
           goal_.text, smallest_size_, goal_.bytes);
    }
    fail(ErrorKind::unmet_goal, "--target {}: {:.6g} was reached; {} is what forbids more",
         goal_.text, result_.reached, bound);
  }

  const Goal& goal_;
  const GoalSource& source_;
  const GoalSteps& steps_;
  Job& job_;
  Storage storage_;
  std::size_t held_;  // where the job's items have that of the models that are tried
  FileSizer own_sizer_;
  GoalResult result_;
  std::map<std::string, MeasuredModel> known_;  // of models that were measured
  double nearest_factor_ = 0;                   // of the largest models so far
  double bytes_of_value_ = 2;
  std::size_t smallest_size_ = 0;
  std::size_t met_ = 0;        // the smallest model that meets an error
  bool exhausted_ = false;     // whether larger decompositions came to nothing more
  double largest_values_ = 0;  // of a decomposition
  // of the most accurate model that is small enough
  double least_error_ = 0;
  double best_values_ = 0;
  std::vector<std::string> best_notes_;
};

}  // namespace

GoalResult meet_goal(const Goal& goal, const GoalSource& source, const GoalSteps& steps, Job& job) {
  return Search(goal, source, steps, job).run();
}

}  // namespace weft
