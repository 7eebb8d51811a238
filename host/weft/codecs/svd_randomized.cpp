#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "weft/codecs/krylov_basis.hpp"
#include "weft/codecs/svd_goal.hpp"
#include "weft/codecs/svd_methods.hpp"
#include "weft/codecs/svd_projection.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

constexpr double wanted_excess = 0.004;  // of the error, foreseen; the promise is 0.01
constexpr double measured_gain = 0.0025;
constexpr double wanted_goal_excess = 0.001;  // where one component more or less hangs on it
constexpr std::size_t most_passes = 24;
constexpr std::size_t first_guess = 64;  // of a rank that a goal will ask for
constexpr std::size_t oversampling = 8;

// What is still to be gained, from the errors of the passes so far, by geometric extrapolation.
double foreseen_gain(const std::vector<double>& errors) {
  const std::size_t t = errors.size();
  if (t < 3) return std::numeric_limits<double>::infinity();
  const double last = errors[t - 2] - errors[t - 1];
  const double before = errors[t - 3] - errors[t - 2];
  if (last <= 0) return 0;
  const double ratio = last / before;
  return before > 0 && ratio < 1 ? last * ratio / (1 - ratio)
                                 : std::numeric_limits<double>::infinity();
}

// What the last pass gained: near rounding, gains do not fall geometrically.
double last_gain(const std::vector<double>& errors) {
  const std::size_t t = errors.size();
  return t < 2 ? std::numeric_limits<double>::infinity()
               : std::max(errors[t - 2] - errors[t - 1], 0.0);
}

class Iteration {
 public:
  Iteration(Device& device, PanelStream& stream, const SvdTarget& target, Job& job)
      : device_(device),
        stream_(stream),
        target_(target),
        job_(job),
        rows_(stream.rows()),
        columns_(stream.columns()),
        block_(randomized_block(device, {rows_, columns_, stream.granule(), stream.arithmetic()},
                                target)),
        basis_(device, rows_, columns_, block_, stream.arithmetic(), job.seed) {
    const std::size_t smaller = std::min(rows_, columns_);
    most_ = target.rank > 0 ? std::min(target.rank, smaller) : smaller;
  }

  StreamedSvd run() { return target_.has_goal() ? run_to_goal() : run_to_rank(); }

 private:
  // One pass: W_t and Y_t, then the energies in the basis.
  void pass() {
    {
      const double flops = 4.0 * static_cast<double>(rows_) * static_cast<double>(columns_) *
                           static_cast<double>(block_);
      const StageTimer timer(job_, "products", flops, stream_.bytes());
      ++svd_.passes;
      basis_.begin_pass();
      stream_.for_each(
          [&](Buffer& panels, std::size_t first, std::size_t count) {
            basis_.multiply(panels, first, count);
            job_.advance(fmt::format("pass {}", svd_.passes), first + count, rows_);
          },
          svd_.passes == 1 ? &svd_.squares : nullptr);
    }
    if (svd_.squares == 0) return;
    const StageTimer timer(job_, "basis");
    const std::vector<double> energies = basis_.energies();
    // W^T W is in double: it does not hold what is below the rounding of that either.
    const double floor =
        std::max(std::pow(noise_floor(stream_.arithmetic(), svd_.squares, target_), 2),
                 static_cast<double>(energies.size()) * 0x1p-52 * energies[0]);
    values_.clear();
    projected_ = 0;
    for (const double energy : energies) {
      if (energy <= floor) break;  // they descend; what is dropped counts as error
      values_.push_back(std::sqrt(energy));
      projected_ += energy;
    }
  }

  // |X - X_k|^2 from norms.
  double rest_by_norms(std::size_t k) const {
    double rest = svd_.squares;
    for (std::size_t j = 0; j < std::min(k, values_.size()); ++j) rest -= values_[j] * values_[j];
    return std::max(rest, 0.0);
  }

  // The leading k Ritz vectors as result.
  void take(std::size_t k) {
    const StageTimer timer(job_, "basis");
    k = std::min(k, values_.size());
    // what an earlier call left would stand beside the new
    svd_.V = Buffer();
    svd_.XV = Buffer();
    svd_.rank = k;
    svd_.values.assign(values_.begin(), values_.begin() + static_cast<std::ptrdiff_t>(k));
    if (k == 0) return;
    svd_.leading = ops::round_up(k, ops::panel_width(device_, stream_.arithmetic()));
    svd_.V = basis_.vectors(k);
    svd_.XV = basis_.products(k);
  }

  bool grow(std::size_t extra, bool bounded) {
    const StageTimer timer(job_, "basis");
    return basis_.grow(extra, bounded);
  }

  double measure() {
    if (svd_.rank == 0) return std::sqrt(svd_.squares);
    return measured_residual(device_, stream_, svd_.V, svd_.XV, svd_.rank, svd_.leading, job_);
  }

  // Until the error is foreseen to be within 1 % of the best; where it is too small beside |X| to
  // be known from norms, it is measured, until it no longer falls.
  StreamedSvd run_to_rank() {
    std::vector<double> errors;
    double measured = std::numeric_limits<double>::infinity();
    const double norm_resolved = resolved_error(stream_.arithmetic());
    // Relative error of rounding: nothing better is to be had.
    const double rounding = stream_.arithmetic() == Arithmetic::f32 ? 1e-6 : 1e-14;
    while (true) {
      pass();
      if (svd_.squares == 0) return std::move(svd_);
      const std::size_t kept = std::min(most_, values_.size());
      errors.push_back(std::sqrt(rest_by_norms(kept) / svd_.squares));
      svd_.residual = errors.back() * std::sqrt(svd_.squares);
      bool done = svd_.passes >= most_passes;
      if (errors.back() >= norm_resolved) {
        done = done || foreseen_gain(errors) <= wanted_excess * errors.back();
      } else if (svd_.passes >= 2) {
        take(kept);
        svd_.residual = measure();
        const double now = svd_.residual / std::sqrt(svd_.squares);
        done = done || now <= rounding || measured - now <= measured_gain * now;
        measured = now;
        if (done) return std::move(svd_);
      }
      // Where the basis can't grow, it holds all there is.
      if (done || !grow(0, true)) {
        take(kept);
        return std::move(svd_);
      }
    }
  }

  // The fewest components that meet the goal, in a basis that grows until it holds them.
  StreamedSvd run_to_goal() {
    const double norm_resolved = resolved_error(stream_.arithmetic());
    while (true) {
      pass();
      if (svd_.squares == 0) return std::move(svd_);
      const double wanted = wanted_squares(target_, svd_.squares);
      const std::size_t dimension = values_.size();
      // what the whole basis leaves, by norms or measured
      double rest = std::max(svd_.squares - projected_, 0.0);
      bool measured = false;
      const double resolved = norm_resolved * norm_resolved * svd_.squares;
      if (rest < resolved && wanted < resolved) {
        take(dimension);
        const double residual = measure();
        rest = residual * residual;
        measured = true;
      }
      history_.push_back({values_, rest});
      const std::size_t within = std::min({most_, dimension, target_.most_columns});
      const std::size_t enough = smallest_rank(values_, rest, wanted);
      const bool met = enough <= within;
      if (met && enough == 0) return finish(0, rest);
      const bool last = svd_.passes >= most_passes;
      // Would one component less do as well after some more passes? Would the cap?
      const std::size_t fewer = met ? enough - 1 : within;
      const double error = error_at(history_.back(), fewer);
      const std::vector<double> errors = errors_at(fewer);
      const double gain = measured ? last_gain(errors) : foreseen_gain(errors);
      const bool converged = last ||
                             gain <= (measured ? measured_gain : wanted_goal_excess) * error ||
                             error - gain > std::sqrt(wanted);
      if (met && converged) return finish(enough, rest);
      if (!met && within == most_ && converged) {
        fail(fewer, error, what_binds(within));
      }
      const std::size_t extra = met || within == most_ ? 0 : missing_columns(rest, wanted);
      if (target_.most_columns < std::min(rows_, columns_) &&
          basis_.dimension() + block_ + extra > target_.most_columns) {
        if (met) return finish(enough, rest);
        fail(within, error,
             memory_binds(within, needed_components(within, error, wanted), job_.memory));
      }
      if (last || !grow(std::min(extra, columns_ - basis_.dimension()), false)) {
        if (met) return finish(enough, rest);
        fail(within, error, what_binds(within));
      }
      block_ = basis_.block();
    }
  }

  struct Step {
    std::vector<double> values;
    double rest = 0;  // left by the whole basis
  };

  static double error_at(const Step& step, std::size_t k) {
    double squares = step.rest;
    for (std::size_t j = step.values.size(); j-- > k;) squares += step.values[j] * step.values[j];
    return std::sqrt(squares);
  }

  // Errors with k components of the passes whose basis held as many.
  std::vector<double> errors_at(std::size_t k) const {
    std::vector<double> errors;
    for (const Step& step : history_) {
      if (step.values.size() >= k) errors.push_back(error_at(step, k));
    }
    return errors;
  }

  // Random directions beside those of the iteration, where the goal is far: no fewer are needed
  // than directions as strong as the median of those known would be.
  std::size_t missing_columns(double rest, double wanted) const {
    const double median = values_.empty() ? 0 : values_[values_.size() / 2];
    if (median == 0) return 0;
    const double missing = (rest - wanted) / (median * median);
    const std::size_t most = basis_.dimension();
    const std::size_t columns = missing < static_cast<double>(most)
                                    ? static_cast<std::size_t>(std::max(missing, 0.0))
                                    : most;
    const std::size_t beyond = columns > block_ ? columns - block_ : 0;
    return ops::round_up(beyond, ops::panel_width(device_, stream_.arithmetic()));
  }

  // No fewer than directions as strong as the median of those known.
  double needed_components(std::size_t k, double error, double wanted) const {
    const double median = values_.empty() ? 0 : values_[values_.size() / 2];
    const double most = static_cast<double>(std::min(rows_, columns_));
    if (median == 0) return most;
    const double missing = std::max(error * error - wanted, 0.0) / (median * median);
    return std::min(static_cast<double>(k) + std::ceil(missing), most);
  }

  const char* what_binds(std::size_t k) const {
    if (k == target_.rank) return "the most that --rank allows";
    return svd_.passes >= most_passes ? "after as many passes as are taken"
                                      : "all that this arithmetic resolves";
  }

  StreamedSvd finish(std::size_t k, double rest) {
    svd_.residual = error_at({values_, rest}, k);
    take(k);
    return std::move(svd_);
  }

  [[noreturn]] void fail(std::size_t k, double error, std::string_view why) const {
    fail_unmet(target_, svd_.squares, error * error, k, why);
  }

  Device& device_;
  PanelStream& stream_;
  const SvdTarget& target_;
  Job& job_;
  std::size_t rows_;
  std::size_t columns_;
  std::size_t block_;
  KrylovBasis basis_;
  std::size_t most_ = 0;
  StreamedSvd svd_;
  std::vector<double> values_;  // lengths of the Ritz vectors that are no noise
  double projected_ = 0;        // their squares
  std::vector<Step> history_;
};

}  // namespace

std::size_t randomized_block(const Device& device, const StreamShape& shape,
                             const SvdTarget& target) {
  const std::size_t smaller = std::min(shape.rows, shape.columns);
  std::size_t rank = std::min(target.rank > 0 ? target.rank : first_guess, smaller);
  if (target.has_goal()) rank = std::min(rank, first_guess);
  // Whole vectors: the last panel of a block may be narrow.
  return std::min(ops::round_up(rank + oversampling, ops::vector_width(device, shape.arithmetic)),
                  smaller);
}

StreamedSvd svd_randomized(Device& device, PanelStream& stream, const SvdTarget& target, Job& job) {
  return Iteration(device, stream, target, job).run();
}

}  // namespace weft
