#include "weft/reference/vq_light_sampler.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "weft/reference/light_sampler.hpp"
#include "weft/reference/lookup.hpp"

namespace weft::reference {
namespace {

using Vector = OnionSlices::Vector;

constexpr double defensive_share = 0.1, defensive_floor = 0.1;

// A coordinate in steps of the grid: the node below, and the part of the step.
struct Place {
  std::size_t below = 0;
  double part = 0;

  double steps() const { return static_cast<double>(below) + part; }
};

// Where the integral of what is linear between value(0), .. value(count - 1)
// comes to a share of it. cumulative(i) is that up to node i, with steps of 1.
template <typename Value, typename Cumulative>
Place invert(std::size_t count, const Value& value, const Cumulative& cumulative, double share) {
  const double target = share * cumulative(count - 1);
  std::size_t low = 0, high = count - 1;
  while (high - low > 1) {
    const std::size_t middle = (low + high) / 2;
    (cumulative(middle) <= target ? low : high) = middle;
  }
  // a x + (b - a) x^2 / 2 = area, the root that has no cancellation
  const double a = value(low), b = value(low + 1);
  const double area = std::max(target - cumulative(low), 0.0);
  const double root = std::sqrt(std::max(0.0, a * a + 2 * (b - a) * area));
  return {low, area > 0 ? std::min(2 * area / (a + root), 1.0) : 0};
}

Place place_of(double steps, std::size_t count) {
  const auto below = std::min(static_cast<std::size_t>(std::max(steps, 0.0)), count - 2);
  return {below, std::clamp(steps - static_cast<double>(below), 0.0, 1.0)};
}

Vector to_double(const std::array<float, 3>& v) {
  return {double{v[0]}, double{v[1]}, double{v[2]}};
}

class VqLightSampler final : public LightSampler {
 public:
  explicit VqLightSampler(const VqModel& model)
      : model_(model),
        onion_(model.grid.sizes),
        n_alpha_(model.grid.sizes.alpha),
        n_beta_(model.grid.sizes.beta),
        gamma_(model.info.btf.encoding == Encoding::linear ? 1 : 2.2),
        slices_(slice_light_sampler(model.info.btf, texel_sampler(model))) {
    const bool times_cosine = model.info.btf.quantity == Quantity::brdf;
    std::vector<double> cos_alpha(n_alpha_), cos_beta(n_beta_);
    for (std::size_t i = 0; i < n_alpha_; ++i) {
      cos_alpha[i] = std::max(std::cos(onion_.alpha(i) * std::numbers::pi / 180), 0.0);
      defence_.along_alpha.push_back(cos_alpha[i] + defensive_floor);
    }
    for (std::size_t k = 0; k < n_beta_; ++k) {
      const double sine = onion_.sine_beta(k);
      cos_beta[k] = std::sqrt(std::max(1 - sine * sine, 0.0));
      slice_values_.push_back(cos_beta[k] + defensive_floor);
    }
    // the code-vectors of P1 after the defensive one
    for (std::size_t i = 0; i < model.p1.size(); ++i) {
      const double factor = times_cosine ? cos_beta[i % n_beta_] : 1;
      slice_values_.push_back(factor * powered(model.p1[i]));
    }
    slice_sums_.resize(slice_values_.size());
    for (std::size_t row = 0; row < slice_values_.size(); row += n_beta_) {
      for (std::size_t k = 1; k < n_beta_; ++k) {
        slice_sums_[row + k] =
            slice_sums_[row + k - 1] + (slice_values_[row + k - 1] + slice_values_[row + k]) / 2;
      }
    }
    for (std::size_t i = 0; i < model.p2.scales.size(); ++i) {
      const double factor = times_cosine ? cos_alpha[i % n_alpha_] : 1;
      const double scale = factor * powered(model.p2.scales[i]);
      hemisphere_scales_.push_back(scale);
      hemisphere_sums_.push_back(scale * sum_of_slice(1 + model.p2.entries[i]));
    }
    defence_.sum = integral(defence_.along_alpha) * sum_of_slice(0);
    density_unit_ = static_cast<double>((n_alpha_ - 1) * (n_beta_ - 1)) / (2 * std::numbers::pi);
  }

  void sample(std::span<const LightQuery> queries, std::span<const std::array<float, 2>> numbers,
              std::span<DrawnLight> out) override {
    validate_light_queries(model_.info.btf.shape, queries);
    validate_light_numbers(numbers);
    Slice slice;
    const LightQuery* found = nullptr;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      if (found == nullptr || !(queries[i] == *found)) find(queries[i], slice);
      found = &queries[i];
      const Place alpha = invert(
          n_alpha_, [&](std::size_t a) { return slice.marginal[a]; },
          [&](std::size_t a) { return slice.cumulative[a]; }, double{numbers[i][0]});
      const Rows rows = rows_at(slice, alpha);
      const Place beta = invert(
          n_beta_, [&](std::size_t b) { return sum_of(rows, slice_values_, b); },
          [&](std::size_t b) { return sum_of(rows, slice_sums_, b); }, double{numbers[i][1]});
      const Vector light = onion_.light(slice.phi, alpha.steps(), beta.steps());
      for (std::size_t c = 0; c < 3; ++c) out[i].direction[c] = static_cast<float>(light[c]);
      out[i].direction[2] = std::max(out[i].direction[2], 0.0f);  // of a rounded horizon
      out[i].density = static_cast<float>(density(rows, beta));
    }
  }

  void densities(std::span<const LightQuery> queries, std::span<const std::array<float, 3>> lights,
                 std::span<float> out) override {
    validate_light_queries(model_.info.btf.shape, queries);
    Slice slice;
    const LightQuery* found = nullptr;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      if (lights[i][2] < 0) {
        out[i] = 0;
        continue;
      }
      if (found == nullptr || !(queries[i] == *found)) find(queries[i], slice);
      found = &queries[i];
      const OnionPosition at = onion_.at(to_double(queries[i].view), to_double(lights[i]));
      out[i] = static_cast<float>(
          density(rows_at(slice, place_of(at.alpha, n_alpha_)), place_of(at.beta, n_beta_)));
    }
  }

  void albedos(std::span<const LightQuery> queries, std::span<float> out) override {
    slices_->albedos(queries, out);
  }

 private:
  // A hemisphere of P2, times what goes to it.
  struct Term {
    std::size_t row = 0;  // of P2, times n_alpha
    double scale = 0;
  };
  // What is drawn from for one query.
  struct Slice {
    double phi = 0;
    std::array<Term, 4> terms{};
    std::size_t count = 0;
    double defence = 0;
    std::vector<double> marginal, cumulative;  // [n_alpha]
  };
  // Code-vectors of P1 and their factors, between two slices.
  struct Rows {
    std::array<std::pair<std::size_t, double>, 9> rows{};  // first value, factor
    std::size_t count = 0;
  };

  double powered(float x) const { return std::pow(std::max(double{x}, 0.0), gamma_); }
  double sum_of_slice(std::size_t row) const { return slice_sums_[(row + 1) * n_beta_ - 1]; }

  static double integral(std::span<const double> nodes) {
    double sum = 0;
    for (std::size_t i = 1; i < nodes.size(); ++i) sum += (nodes[i - 1] + nodes[i]) / 2;
    return sum;
  }

  // The terms of a view and a texel, of integral 1 with the defensive one.
  void find(const LightQuery& query, Slice& slice) const {
    const OnionPosition at = onion_.at(to_double(query.view), {0, 0, 1});
    const OnionStep phi = onion_.phi_step(at.phi), theta = onion_.theta_step(at.theta);
    const std::size_t per_pair = model_.chromaticities > 0 ? 2 : 1;
    const std::size_t of_texel = model_.p6.entries[query.texel] * model_.grid.sizes.phi;
    slice.phi = at.phi;
    slice.count = 0;
    slice.marginal.assign(n_alpha_, 0.0);
    for (const auto& [p, of_phi] :
         {std::pair(phi.low, 1 - phi.fraction), {phi.high, phi.fraction}}) {
      if (of_phi == 0) continue;
      const std::size_t k4 = of_texel + p;
      const std::size_t of_view = model_.p4.entries[k4] * model_.grid.sizes.theta;
      for (const auto& [t, of_theta] :
           {std::pair(theta.low, 1 - theta.fraction), {theta.high, theta.fraction}}) {
        if (of_theta == 0) continue;
        const std::size_t k3 = of_view + t;
        Term& term = slice.terms[slice.count++];
        term.row = model_.m[model_.p3.entries[k3] * per_pair] * n_alpha_;
        term.scale =
            of_phi * of_theta * powered(model_.p4.scales[k4]) * powered(model_.p3.scales[k3]);
        for (std::size_t i = 0; i < n_alpha_; ++i) {
          slice.marginal[i] += term.scale * hemisphere_sums_[term.row + i];
        }
      }
    }
    const double sum = integral(slice.marginal);
    const bool black = !std::isnormal(sum) || !std::isnormal(1 / sum);
    const double factor = black ? 0 : (1 - defensive_share) / sum;
    slice.defence = (black ? 1 : defensive_share) / defence_.sum;
    for (std::size_t t = 0; t < slice.count; ++t) slice.terms[t].scale *= factor;
    slice.cumulative.resize(n_alpha_);
    for (std::size_t i = 0; i < n_alpha_; ++i) {
      slice.marginal[i] =
          factor * slice.marginal[i] + slice.defence * defence_.along_alpha[i] * sum_of_slice(0);
      if (i > 0) {
        slice.cumulative[i] =
            slice.cumulative[i - 1] + (slice.marginal[i - 1] + slice.marginal[i]) / 2;
      }
    }
  }

  Rows rows_at(const Slice& slice, const Place& alpha) const {
    Rows rows;
    const auto add = [&](std::size_t row, double factor) {
      if (factor > 0) rows.rows[rows.count++] = {row * n_beta_, factor};
    };
    const auto& d = defence_.along_alpha;
    add(0, slice.defence * ((1 - alpha.part) * d[alpha.below] + alpha.part * d[alpha.below + 1]));
    for (std::size_t t = 0; t < slice.count; ++t) {
      for (const std::size_t step : {std::size_t{0}, std::size_t{1}}) {
        const std::size_t i = slice.terms[t].row + alpha.below + step;
        const double part = step == 0 ? 1 - alpha.part : alpha.part;
        add(1 + model_.p2.entries[i], part * slice.terms[t].scale * hemisphere_scales_[i]);
      }
    }
    return rows;
  }

  static double sum_of(const Rows& rows, const std::vector<double>& values, std::size_t node) {
    double sum = 0;
    for (std::size_t r = 0; r < rows.count; ++r) {
      sum += rows.rows[r].second * values[rows.rows[r].first + node];
    }
    return sum;
  }

  // p per unit of solid angle, where rows are in steps of the grid.
  double density(const Rows& rows, const Place& beta) const {
    return density_unit_ * ((1 - beta.part) * sum_of(rows, slice_values_, beta.below) +
                            beta.part * sum_of(rows, slice_values_, beta.below + 1));
  }

  const VqModel& model_;
  OnionSlices onion_;
  std::size_t n_alpha_, n_beta_;
  double gamma_;
  std::unique_ptr<LightSampler> slices_;  // for albedos
  struct {
    std::vector<double> along_alpha;
    double sum = 0;
  } defence_;
  // The defensive slice and those of P1, [1 + S1][n_beta]: values, and their
  // integral up to each.
  std::vector<double> slice_values_, slice_sums_;
  std::vector<double> hemisphere_scales_, hemisphere_sums_;  // [S2][n_alpha]
  double density_unit_ = 0;  // steps of the grid per unit of solid angle
};

}  // namespace

std::unique_ptr<LightSampler> vq_light_sampler(const VqModel& model) {
  const OnionSizes& sizes = model.grid.sizes;
  const bool has_luminance =
      std::find(model.channels.begin(), model.channels.end(), 0) != model.channels.end();
  if (model.grid.kind != VqGrid::Kind::onion || sizes.alpha < 2 || sizes.beta < 2 ||
      !has_luminance || !model.info.colour_transform.is_linear()) {
    return nullptr;
  }
  return std::make_unique<VqLightSampler>(model);
}

}  // namespace weft::reference
