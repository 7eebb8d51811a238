#include "weft/reference/vq_light_sampler.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "weft/reference/light_sampler.hpp"
#include "weft/reference/lookup.hpp"

namespace weft::reference {
namespace {

constexpr double defensive_share = 0.1, defensive_floor = 0.1;
// Queries that are worth a thread of their own.
constexpr std::size_t least_share = 2048;
// Rows of tables are padded to whole vectors of this many floats.
constexpr std::size_t lanes = 4;

// A coordinate in steps of the grid: the node below, and the part of the step.
struct Place {
  std::size_t below = 0;
  double part = 0;

  double steps() const { return static_cast<double>(below) + part; }
};

Place place_of(double steps, std::size_t count) {
  const auto below = std::min(static_cast<std::size_t>(std::max(steps, 0.0)), count - 2);
  return {below, std::clamp(steps - static_cast<double>(below), 0.0, 1.0)};
}

// Rows of a table of two parts, of so many columns each, with a factor each.
struct Row {
  std::size_t number = 0;
  float factor = 0;
};
template <std::size_t N>
struct RowSum {
  std::array<Row, N> rows{};
  std::size_t count = 0;

  void add(std::size_t number, float factor) {
    if (factor > 0) rows[count++] = {number, factor};
  }
  // At one column of the first part, the values.
  double at(const std::vector<float>& table, std::size_t width, std::size_t column) const {
    float sum = 0;
    for (std::size_t r = 0; r < count; ++r) {
      sum += rows[r].factor * table[2 * rows[r].number * width + column];
    }
    return static_cast<double>(sum);
  }
  // At all columns of the second, the sums.
  void get_sums(const std::vector<float>& table, std::size_t width, float* out) const {
    for (std::size_t i = 0; i < width; i += lanes) {
      std::array<float, lanes> sums{};
      for (std::size_t r = 0; r < count; ++r) {
        const float* const row = &table[(2 * rows[r].number + 1) * width + i];
        for (std::size_t k = 0; k < lanes; ++k) sums[k] += rows[r].factor * row[k];
      }
      for (std::size_t k = 0; k < lanes; ++k) out[i + k] = sums[k];
    }
  }
};

// The interval in which ascending sums come to a share of their last, and the share of it.
struct Interval {
  std::size_t below = 0;
  double share = 0;
};
Interval find(const float* sums, std::size_t count, double share) {
  const float target = static_cast<float>(share) * sums[count - 1];
  std::size_t below = 0;
  for (std::size_t i = 1; i + 1 < count; ++i) below += sums[i] <= target ? 1 : 0;
  const double width = double{sums[below + 1]} - double{sums[below]};
  const double part = double{target} - double{sums[below]};
  return {below, width > 0 ? std::clamp(part / width, 0.0, 1.0) : 0};
}

// The part x of a step below which that share of what is linear from a to b lies: a x + (b - a) x^2
// / 2 = share (a + b) / 2, by the root that has no cancellation.
double part_below(double a, double b, double share) {
  const double root = std::sqrt(std::max(a * a + (b * b - a * a) * share, 0.0));
  return a + root > 0 ? std::min(share * (a + b) / (a + root), 1.0) : share;
}

class VqLightSampler final : public LightSampler {
 public:
  VqLightSampler(const VqModel& model, std::size_t threads)
      : model_(model),
        onion_(model.grid.sizes),
        n_alpha_(model.grid.sizes.alpha),
        n_beta_(model.grid.sizes.beta),
        width_alpha_((n_alpha_ + lanes - 1) / lanes * lanes),
        width_beta_((n_beta_ + lanes - 1) / lanes * lanes),
        gamma_(model.info.btf.encoding == Encoding::linear ? 1 : 2.2),
        threads_(threads > 0 ? threads
                             : std::max<std::size_t>(1, std::thread::hardware_concurrency())),
        albedos_(slice_light_sampler(model.info.btf, texel_sampler(model))) {
    make_slices();
    make_hemispheres();
    const std::size_t per_pair = model.chromaticities > 0 ? 2 : 1;
    p3_ = links(model.p3, [&](std::uint32_t k) { return model.m[k * per_pair]; });
    p4_ = links(model.p4, [](std::uint32_t k) { return k; });
    density_unit_ = static_cast<double>((n_alpha_ - 1) * (n_beta_ - 1)) / (2 * std::numbers::pi);
  }

  void sample(std::span<const LightQuery> queries, std::span<const std::array<float, 2>> numbers,
              std::span<DrawnLight> out) override {
    validate_light_queries(model_.info.btf.shape, queries);
    validate_light_numbers(numbers);
    for_each_slice(queries, [&](std::size_t i, const Slice& slice, std::span<float> sums) {
      out[i] = draw(slice, numbers[i], sums);
    });
  }

  void densities(std::span<const LightQuery> queries, std::span<const std::array<float, 3>> lights,
                 std::span<float> out) override {
    validate_light_queries(model_.info.btf.shape, queries);
    for_each_slice(queries, [&](std::size_t i, const Slice& slice, std::span<float>) {
      out[i] = density(slice, lights[i]);
    });
  }

  void albedos(std::span<const LightQuery> queries, std::span<float> out) override {
    albedos_->albedos(queries, out);
  }

 private:
  // An entry of a code-book: the row of the table below that it points to, and its scale as light,
  // relative to the largest.
  struct Link {
    std::uint32_t row = 0;
    float scale = 0;
  };
  // What is drawn from for one query: rows of hemispheres_ that sum to 1, and the cosine and sine
  // of the view's azimuth.
  struct Slice {
    RowSum<5> rows;
    double cosine = 1, sine = 0;
    std::vector<float> sums;  // along alpha
  };

  double powered(double x) const { return std::pow(std::max(x, 0.0), gamma_); }
  double alpha(std::size_t i) const { return onion_.alpha(i) * std::numbers::pi / 180; }

  // Values and sums of one row, in double, at the end of a table.
  static void append(std::span<const double> values, std::size_t width, std::vector<float>& table) {
    const std::size_t first = table.size();
    table.resize(first + 2 * width);
    double sum = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (i > 0) sum += (values[i - 1] + values[i]) / 2;
      table[first + i] = static_cast<float>(values[i]);
      table[first + width + i] = static_cast<float>(sum);
    }
  }

  // The defensive slice, and the code-vectors of P1.
  void make_slices() {
    std::vector<double> cosines(n_beta_), row(n_beta_);
    for (std::size_t k = 0; k < n_beta_; ++k) {
      const double sine = onion_.sine_beta(k);
      cosines[k] = std::sqrt(std::max(1 - sine * sine, 0.0));
      row[k] = cosines[k] + defensive_floor;
    }
    append(row, width_beta_, slices_);
    const double largest = largest_of(model_.p1);
    const bool times_cosine = model_.info.btf.quantity == Quantity::brdf;
    for (std::size_t first = 0; first < model_.p1.size(); first += n_beta_) {
      for (std::size_t k = 0; k < n_beta_; ++k) {
        row[k] = powered(double{model_.p1[first + k]} / largest) * (times_cosine ? cosines[k] : 1);
      }
      append(row, width_beta_, slices_);
    }
  }
  double sum_of_slice(std::size_t row) const {
    return double{slices_[(2 * row + 1) * width_beta_ + n_beta_ - 1]};
  }

  // The entries of P2 and, in the last row, the defensive hemisphere.
  void make_hemispheres() {
    std::vector<double> cosines(n_alpha_), row(n_alpha_);
    for (std::size_t i = 0; i < n_alpha_; ++i) cosines[i] = std::max(std::cos(alpha(i)), 0.0);
    p2_ = links(model_.p2, [](std::uint32_t k) { return 1 + k; });
    const bool times_cosine = model_.info.btf.quantity == Quantity::brdf;
    for (std::size_t first = 0; first < p2_.size(); first += n_alpha_) {
      for (std::size_t i = 0; i < n_alpha_; ++i) {
        Link& link = p2_[first + i];
        if (times_cosine) link.scale *= static_cast<float>(cosines[i]);
        row[i] = double{link.scale} * sum_of_slice(link.row);
      }
      append(row, width_alpha_, hemispheres_);
    }
    defence_ = hemispheres_.size() / (2 * width_alpha_);
    for (std::size_t i = 0; i < n_alpha_; ++i) {
      p2_.push_back({0, static_cast<float>(cosines[i] + defensive_floor)});
      row[i] = double{p2_.back().scale} * sum_of_slice(0);
    }
    append(row, width_alpha_, hemispheres_);
  }

  static double largest_of(std::span<const float> values) {
    float largest = 0;
    for (const float value : values) largest = std::max(largest, value);
    return largest > 0 ? double{largest} : 1;
  }

  template <typename RowOf>
  std::vector<Link> links(const VqCodeBook& book, const RowOf& row_of) const {
    const double largest = largest_of(book.scales);
    std::vector<Link> result;
    result.reserve(book.scales.size());
    for (std::size_t k = 0; k < book.scales.size(); ++k) {
      result.push_back(
          {row_of(book.entries[k]), static_cast<float>(powered(double{book.scales[k]} / largest))});
    }
    return result;
  }

  // Calls work(i, slice, room for n_beta sums) for each query, in several threads where there are
  // many.
  template <typename Work>
  void for_each_slice(std::span<const LightQuery> queries, const Work& work) const {
    struct Scratch {
      Slice slice;
      std::vector<float> sums;
    };
    const std::size_t shares = std::clamp<std::size_t>(queries.size() / least_share, 1, threads_);
    std::vector<Scratch> scratches(shares);
    for (Scratch& scratch : scratches) {
      scratch.slice.sums.resize(width_alpha_);
      scratch.sums.resize(width_beta_);
    }
    const auto run = [&](std::size_t share) {
      Scratch& scratch = scratches[share];
      const LightQuery* found = nullptr;
      const std::size_t end = queries.size() * (share + 1) / shares;
      for (std::size_t i = queries.size() * share / shares; i < end; ++i) {
        if (found == nullptr || !(queries[i] == *found)) find_slice(queries[i], scratch.slice);
        found = &queries[i];
        work(i, std::as_const(scratch.slice), scratch.sums);
      }
    };
    std::vector<std::jthread> threads;
    for (std::size_t share = 1; share < shares; ++share) threads.emplace_back(run, share);
    run(0);
  }

  // The hemispheres of a view and a texel, of integral 1 with the defensive one.
  void find_slice(const LightQuery& query, Slice& slice) const {
    const double x = double{query.view[0]}, y = double{query.view[1]};
    const double z = std::max(double{query.view[2]}, 0.0);
    const double across = std::sqrt(x * x + y * y);
    slice.cosine = across > 0 ? x / across : 1;
    slice.sine = across > 0 ? y / across : 0;
    const OnionSizes& n = onion_.sizes();
    const double turns = n.phi > 1 && across > 0 ? std::atan2(y, x) / (2 * std::numbers::pi) : 0;
    // straight down is the horizon at azimuth 0
    const double elevation = across > 0 || z > 0 ? std::atan2(across, z) / std::numbers::pi : 0.5;
    const OnionStep phi = onion_.phi_step(turns * static_cast<double>(n.phi));
    const OnionStep theta = onion_.theta_step(2 * elevation * static_cast<double>(n.theta - 1));
    const std::size_t of_texel = model_.p6.entries[query.texel] * n.phi;
    struct Term {
      std::size_t row;
      double scale;
    };
    std::array<Term, 4> terms{};
    std::size_t count = 0;
    double sum = 0;
    for (const auto& [p, of_phi] :
         {std::pair(phi.low, 1 - phi.fraction), {phi.high, phi.fraction}}) {
      if (of_phi == 0) continue;
      const Link& in_p4 = p4_[of_texel + p];
      for (const auto& [t, of_theta] :
           {std::pair(theta.low, 1 - theta.fraction), {theta.high, theta.fraction}}) {
        if (of_theta == 0) continue;
        const Link& in_p3 = p3_[in_p4.row * n.theta + t];
        const double scale = of_phi * of_theta * double{in_p4.scale} * double{in_p3.scale};
        sum += scale * sum_of_hemisphere(in_p3.row);
        terms[count++] = {in_p3.row, scale};
      }
    }
    const bool black = !std::isnormal(sum) || !std::isnormal(1 / sum);
    slice.rows.count = 0;
    slice.rows.add(defence_,
                   static_cast<float>((black ? 1 : defensive_share) / sum_of_hemisphere(defence_)));
    for (std::size_t t = 0; t < count && !black; ++t) {
      slice.rows.add(terms[t].row,
                     static_cast<float>((1 - defensive_share) / sum * terms[t].scale));
    }
    slice.rows.get_sums(hemispheres_, width_alpha_, slice.sums.data());
  }
  double sum_of_hemisphere(std::size_t row) const {
    return double{hemispheres_[(2 * row + 1) * width_alpha_ + n_alpha_ - 1]};
  }

  // The slices next to a place of alpha.
  RowSum<10> slices_at(const Slice& slice, const Place& alpha) const {
    RowSum<10> rows;
    for (std::size_t r = 0; r < slice.rows.count; ++r) {
      const Row& row = slice.rows.rows[r];
      const Link* const in_p2 = &p2_[row.number * n_alpha_ + alpha.below];
      const auto part = static_cast<float>(alpha.part);
      rows.add(in_p2[0].row, (1 - part) * row.factor * in_p2[0].scale);
      rows.add(in_p2[1].row, part * row.factor * in_p2[1].scale);
    }
    return rows;
  }

  DrawnLight draw(const Slice& slice, const std::array<float, 2>& numbers,
                  std::span<float> sums) const {
    const Interval in_alpha = find(slice.sums.data(), n_alpha_, double{numbers[0]});
    const Place alpha{
        in_alpha.below,
        part_below(slice.rows.at(hemispheres_, width_alpha_, in_alpha.below),
                   slice.rows.at(hemispheres_, width_alpha_, in_alpha.below + 1), in_alpha.share)};
    const RowSum<10> rows = slices_at(slice, alpha);
    rows.get_sums(slices_, width_beta_, sums.data());
    const Interval in_beta = find(sums.data(), n_beta_, double{numbers[1]});
    const double low = rows.at(slices_, width_beta_, in_beta.below);
    const double high = rows.at(slices_, width_beta_, in_beta.below + 1);
    const double part = part_below(low, high, in_beta.share);

    // the direction, turned with the view, and turned back
    const double angle =
        std::numbers::pi * (alpha.steps() / static_cast<double>(n_alpha_ - 1) - 0.5);
    const double along = 2 * Place{in_beta.below, part}.steps() / static_cast<double>(n_beta_ - 1);
    const double y = along - 1;
    const double radius = std::sqrt(std::max(1 - y * y, 0.0));
    const double x = std::sin(angle) * radius;
    DrawnLight light;
    light.direction = {static_cast<float>(slice.cosine * x - slice.sine * y),
                       static_cast<float>(slice.sine * x + slice.cosine * y),
                       static_cast<float>(std::max(std::cos(angle) * radius, 0.0))};
    light.density = static_cast<float>(density_unit_ * ((1 - part) * low + part * high));
    return light;
  }

  // p per unit of solid angle, where rows are in steps of the grid.
  float density(const Slice& slice, const std::array<float, 3>& light) const {
    if (light[2] < 0) return 0;
    const double x = slice.cosine * double{light[0]} + slice.sine * double{light[1]};
    const double y = slice.cosine * double{light[1]} - slice.sine * double{light[0]};
    const double z = double{light[2]};
    const double turns = x == 0 && z == 0 ? 0 : std::atan2(x, z) / std::numbers::pi;
    const Place alpha = place_of((turns + 0.5) * static_cast<double>(n_alpha_ - 1), n_alpha_);
    const Place beta = place_of((y + 1) / 2 * static_cast<double>(n_beta_ - 1), n_beta_);
    const RowSum<10> rows = slices_at(slice, alpha);
    return static_cast<float>(density_unit_ *
                              ((1 - beta.part) * rows.at(slices_, width_beta_, beta.below) +
                               beta.part * rows.at(slices_, width_beta_, beta.below + 1)));
  }

  const VqModel& model_;
  OnionSlices onion_;
  std::size_t n_alpha_, n_beta_;
  std::size_t width_alpha_, width_beta_;  // of rows
  double gamma_;
  std::size_t threads_;
  std::unique_ptr<LightSampler> albedos_;
  std::vector<Link> p4_, p3_, p2_;  // to p3_, hemispheres_ and slices_
  std::vector<float> slices_;       // [1 + S1][2][width_beta], the defensive slice first
  std::vector<float> hemispheres_;  // [S2 + 1][2][width_alpha], the defensive one last
  std::size_t defence_ = 0;         // in hemispheres_
  double density_unit_ = 0;         // steps of the grid per unit of solid angle
};

}  // namespace

std::unique_ptr<LightSampler> vq_light_sampler(const VqModel& model, std::size_t threads) {
  const OnionSizes& sizes = model.grid.sizes;
  const bool has_luminance =
      std::find(model.channels.begin(), model.channels.end(), 0) != model.channels.end();
  if (model.grid.kind != VqGrid::Kind::onion || sizes.alpha < 2 || sizes.beta < 2 ||
      !has_luminance || !model.info.colour_transform.is_linear()) {
    return nullptr;
  }
  return std::make_unique<VqLightSampler>(model, threads);
}

}  // namespace weft::reference
