#include "weft/codecs/sparse_goal.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "weft/error.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/sparse_lengths.hpp"
#include "weft/model/storage.hpp"

namespace weft {
namespace {

// The part of a squared error beyond which the projection gets a higher rank.
constexpr double projection_squares = 0.5;
// Trials that go by the error foreseen; those behind halve what is left.
constexpr int foreseen_trials = 6;

// The error that fits reach, from those foreseen: e = c f^p through the last two fits.
class ErrorTrend {
 public:
  void add(double foreseen, double reached) {
    const double f = std::log(foreseen);
    const double e = std::log(reached);
    if (fits_ > 0 && f != f_) power_ = std::clamp((e - e_) / (f - f_), 0.25, 4.0);
    f_ = f;
    e_ = e;
    ++fits_;
  }
  double of(double foreseen) const { return std::exp(e_ + power_ * (std::log(foreseen) - f_)); }

 private:
  int fits_ = 0;
  double power_ = 1;
  double f_ = 0;
  double e_ = 0;
};

class GoalSearch {
 public:
  GoalSearch(SparseEncoder& encoder, const BtfInfo& source, const SparseOptions& options,
             MeasureSparse measure, Job& job)
      : encoder_(encoder),
        source_(source),
        options_(options),
        measure_(std::move(measure)),
        job_(job),
        sizes_(source.shape, options) {}

  // Choices for models of about so many numbers, or of the goal's error; none of data that is its
  // mean.
  const std::vector<SparseLengthChoice>& choose(double numbers) {
    encoder_.project(options_.rank);
    if (encoder_.rank() == 0) return choices_;
    if (options_.goal.kind == FitGoal::Kind::relative) {
      decompose_for_error();
      return choices_;
    }
    for (;;) {
      decompose_long(static_cast<std::size_t>(numbers) * real_bytes());
      std::size_t last = choices_.size() - 1;
      while (last > 0 && numbers_of(choices_[last]) > numbers) --last;
      if (!raise_rank(choices_[last].squares)) return choices_;
    }
  }

  // With an index for each coefficient.
  double numbers_of(const SparseLengthChoice& choice) const {
    const std::size_t of_views = sizes_.abrdf_atoms * source_.shape.views * choice.view_terms;
    const std::size_t of_texels = sizes_.texels * choice.texel_terms;
    return static_cast<double>(2 * (of_views + of_texels) + sizes_.light_atoms * sizes_.fibre +
                               sizes_.row);
  }

  // Whether lists are as long as they may be.
  bool longest() const {
    return choices_.empty() || (choices_.back().view_terms == options_.view_terms &&
                                choices_.back().texel_terms == options_.texel_terms);
  }

  SparseFit fit() {
    encoder_.project(options_.rank);
    const FitGoal& goal = options_.goal;
    if (!goal || encoder_.rank() == 0) return fit_as_given();
    return goal.kind == FitGoal::Kind::size ? fit_size() : fit_relative();
  }

  // Relative error of a choice, from the long lists.
  double foreseen(const SparseLengthChoice& choice) const {
    return std::sqrt(std::pow(encoder_.projection_error(), 2) + choice.squares);
  }

  // The decomposition with these lengths, from the dictionaries of the long lists.
  SparseFit refit(const SparseLengthChoice& choice) {
    SparseFit fit = stored(encoder_.refit(choice.view_terms, choice.texel_terms,
                                          options_.iterations - first_iterations()));
    job_.notes.push_back(fmt::format(
        "k1 {}, k2 {}: relative error foreseen {:.4g} from longer lists, {:.4g} from these "
        "(projection {:.4g}, texels {:.4g}, views {:.4g})",
        choice.view_terms, choice.texel_terms, foreseen(choice), fit.errors.foreseen(),
        fit.errors.projection, fit.errors.texels, fit.errors.views));
    return fit;
  }

  // Lengths as they are, or data that is its mean.
  SparseFit fit_as_given() {
    SparseFit fit =
        stored(encoder_.fit(options_.view_terms, options_.texel_terms, options_.iterations));
    const FitGoal& goal = options_.goal;
    const std::size_t bytes = model_file_size(*fit.model);
    if (goal.kind == FitGoal::Kind::size && bytes > goal.bytes) {
      fail(ErrorKind::unmet_goal, "--target {}: the mean alone takes {} bytes, {} are allowed",
           goal.text, bytes, goal.bytes);
    }
    return fit;
  }

 private:
  SparseFit fit_size() {
    const FitGoal& goal = options_.goal;
    for (;;) {
      decompose_long(goal.bytes);
      std::size_t last = choices_.size();
      while (last > 0 && choices_[last - 1].bytes > goal.bytes) --last;
      if (last == 0) {
        fail(ErrorKind::unmet_goal,
             "--target {}: lists of one term take {} bytes, {} are allowed; fewer --atoms take "
             "less",
             goal.text, choices_.front().bytes, goal.bytes);
      }
      const SparseLengthChoice& choice = choices_[last - 1];
      if (!raise_rank(choice.squares)) return refit(choice);
    }
  }

  SparseFit fit_relative() {
    const FitGoal& goal = options_.goal;
    decompose_for_error();

    // choices_[meeting] meets the goal, if it is one; all before `untried` miss it
    std::size_t untried = 0;
    std::size_t meeting = choices_.size();
    SparseFit best;
    double least = 1;
    ErrorTrend trend;
    for (int trial = 0; untried < meeting; ++trial) {
      std::size_t next = untried + (meeting - untried) / 2;
      if (trial < foreseen_trials) {
        next = untried;
        while (next + 1 < meeting && trend.of(foreseen(choices_[next])) > goal.relative) ++next;
      }
      SparseFit fit = refit(choices_[next]);
      const double reached = measure_(*fit.model);
      job_.notes.push_back(fmt::format("relative error reached {:.4g}", reached));
      trend.add(foreseen(choices_[next]), reached);
      least = std::min(least, reached);
      if (reached <= goal.relative) {
        meeting = next;
        best = std::move(fit);
      } else {
        untried = next + 1;
      }
    }
    if (!best.model) {
      fail(ErrorKind::unmet_goal,
           "--target {}: k1 = {}, k2 = {} and {} components reach {:.4g}; raise --k1, --k2, "
           "--atoms or --rank",
           goal.text, choices_.back().view_terms, choices_.back().texel_terms, encoder_.rank(),
           least);
    }
    return best;
  }

  // With as many components as the goal takes.
  void decompose_for_error() {
    const FitGoal& goal = options_.goal;
    const double square = goal.relative * goal.relative;
    while (raise_rank(square - std::pow(encoder_.projection_error(), 2))) {
    }
    if (encoder_.projection_error() >= goal.relative) {
      fail(ErrorKind::unmet_goal,
           "--target {}: the projection onto {} components alone leaves {:.4g}; raise --rank",
           goal.text, encoder_.rank(), encoder_.projection_error());
    }
    decompose_long(std::numeric_limits<std::size_t>::max());
  }

  std::size_t first_iterations() const { return (options_.iterations + 1) / 2; }

  // A decomposition with long lists, no longer than `most_bytes` of one kind, and what there is to
  // choose from it.
  void decompose_long(std::size_t most_bytes) {
    const auto length = [&](std::size_t terms, std::size_t lists, std::size_t atoms) {
      return std::clamp<std::size_t>(most_bytes / (lists * term_bytes(atoms)), 1, terms);
    };
    const SparseFit fit = stored(encoder_.fit(
        length(options_.view_terms, sizes_.abrdf_atoms * source_.shape.views, sizes_.light_atoms),
        length(options_.texel_terms, sizes_.texels, sizes_.abrdf_atoms), first_iterations()));
    const StageTimer timer(job_, "errors of shorter lists");
    const SparseLengthErrors errors = encoder_.length_errors();
    choices_ = best_lengths(errors.views, errors.texels, length_bytes(*fit.model));
  }

  // Whether the rank was raised, since the projection makes most of the squared error beside
  // `squares`.
  bool raise_rank(double squares) {
    const std::size_t next = std::min(2 * options_.rank, options_.most_rank);
    const double projection = std::pow(encoder_.projection_error(), 2);
    if (encoder_.rank() < options_.rank || next <= options_.rank ||
        projection <= projection_squares * (projection + squares)) {
      return false;
    }
    job_.notes.push_back(
        fmt::format("rank {} raised to {}: the projection leaves {:.4g}, most of the error",
                    options_.rank, next, encoder_.projection_error()));
    try {
      encoder_.project(next);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::input) throw;
      fail_input("--target {} needs {} components rather than {}, which --rank {} would keep: {}",
                 options_.goal.text, next, options_.rank, options_.rank, error.what());
    }
    options_.rank = next;
    return true;
  }

  SparseFit stored(SparseFit fit) const {
    fit.model->info.codec = "sparse";
    fit.model->info.storage = options_.storage;
    fit.model->info.btf = source_;
    round_to_storage(*fit.model);
    return fit;
  }

  std::size_t real_bytes() const { return options_.storage == Storage::f16 ? 2 : 4; }
  // Of a term of lists of so many atoms.
  std::size_t term_bytes(std::size_t atoms) const {
    return size_of(IndexTensor({}, atoms).dtype()) + real_bytes();
  }

  // Bytes of the file for other lengths than those of `model`, with all atoms in use.
  LengthBytes length_bytes(const SparseModel& model) const {
    const std::size_t scale = options_.storage == Storage::f16 ? sizeof(float) : 0;
    const std::size_t light_atom = sizes_.fibre * real_bytes() + scale;
    // the header's numbers may be longer by some digits, and the parameters are still to come
    constexpr std::size_t digits = 512;
    const std::size_t without_lists =
        model_file_size(model) - model.views.coefficients.size() * term_bytes(model.light_atoms) -
        model.texels.coefficients.size() * term_bytes(model.abrdf_atoms) -
        model.light_atoms * light_atom - model.abrdf_atoms * scale;
    const std::size_t fixed =
        without_lists + digits + sizes_.light_atoms * light_atom + sizes_.abrdf_atoms * scale;
    const std::size_t of_views =
        sizes_.abrdf_atoms * source_.shape.views * term_bytes(sizes_.light_atoms);
    const std::size_t of_texels = sizes_.texels * term_bytes(sizes_.abrdf_atoms);
    return [=](std::size_t k1, std::size_t k2) { return fixed + k1 * of_views + k2 * of_texels; };
  }

  SparseEncoder& encoder_;
  const BtfInfo& source_;
  SparseOptions options_;
  MeasureSparse measure_;
  Job& job_;
  SparseSizes sizes_;
  std::vector<SparseLengthChoice> choices_;
};

class NestedSparse final : public NestedModels {
 public:
  NestedSparse(std::unique_ptr<SparseEncoder> encoder, const BtfInfo& source,
               const SparseOptions& options, const NestedRequest& request, FinishSparse finish,
               Job& job)
      : encoder_(std::move(encoder)),
        search_(*encoder_, source, options, {}, job),
        choices_(search_.choose(request.growth * static_cast<double>(request.values))),
        finish_(std::move(finish)) {}

  std::size_t count() const override { return std::max<std::size_t>(choices_.size(), 1); }
  std::unique_ptr<Model> model(std::size_t i) const override {
    auto known = made_.find(i);
    if (known == made_.end()) {
      const std::unique_ptr<Model> made =
          finish_(choices_.empty() ? search_.fit_as_given() : search_.refit(choices_[i]));
      known = made_.emplace(i, dynamic_cast<const SparseModel&>(*made)).first;
    }
    return std::make_unique<SparseModel>(known->second);
  }
  std::size_t values(std::size_t i) const override {
    return choices_.empty() ? 1 : static_cast<std::size_t>(search_.numbers_of(choices_[i]));
  }
  double error(std::size_t i) const override {
    return choices_.empty() ? 0 : search_.foreseen(choices_[i]);
  }
  bool complete() const override { return search_.longest(); }
  std::string bound() const override {
    if (choices_.empty()) return "data that is its mean";
    return fmt::format("k1 = {}, k2 = {} and {} components (--k1, --k2, --atoms, --rank)",
                       choices_.back().view_terms, choices_.back().texel_terms, encoder_->rank());
  }

 private:
  std::unique_ptr<SparseEncoder> encoder_;
  mutable GoalSearch search_;
  const std::vector<SparseLengthChoice>& choices_;
  FinishSparse finish_;
  mutable std::map<std::size_t, SparseModel> made_;  // that were asked for
};

}  // namespace

SparseSizes::SparseSizes(const BtfShape& shape, const SparseRequest& request)
    : texels(shape.texels()),
      row(shape.images() * shape.channels),
      fibre(shape.lights * shape.channels),
      rank(std::min({request.rank, texels, row})),
      abrdf_atoms(std::min(request.abrdf_atoms, texels)),
      light_atoms(std::min(request.light_atoms, abrdf_atoms * shape.views)) {}

SparseFit fit_sparse(SparseEncoder& encoder, const BtfInfo& source, const SparseOptions& options,
                     const MeasureSparse& measure, Job& job) {
  return GoalSearch(encoder, source, options, measure, job).fit();
}

std::unique_ptr<NestedModels> nested_sparse(std::unique_ptr<SparseEncoder> encoder,
                                            const BtfInfo& source, const SparseOptions& options,
                                            const NestedRequest& request, FinishSparse finish,
                                            Job& job) {
  SparseOptions wanted = options;
  FitGoal& goal = wanted.goal;
  goal.kind = request.relative > 0 ? FitGoal::Kind::relative : FitGoal::Kind::size;
  goal.relative = request.relative;
  goal.bytes = std::numeric_limits<std::size_t>::max();
  goal.text = request.relative > 0 ? fmt::format("rel={:.4g}", request.relative)
                                   : fmt::format("size: a model of {} numbers", request.values);
  return std::make_unique<NestedSparse>(std::move(encoder), source, wanted, request,
                                        std::move(finish), job);
}

}  // namespace weft
