#include "weft/codecs/nested_components.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <utility>
#include <vector>

namespace weft {
namespace {

std::vector<double> row_squares(std::span<const float> rows, std::size_t width) {
  std::vector<double> squares(rows.size() / width, 0.0);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    squares[i / width] += double{rows[i]} * double{rows[i]};
  }
  return squares;
}

// The text of a model's parameters up to the member that says what was kept; see with_kept.
std::string without_kept(const std::string& parameters, std::string_view member) {
  return parameters.substr(0, parameters.find(member));
}

// Bases' components in the order that they are taken in.
class Order {
 public:
  // `squares`: of each basis, from its first component on. `room(basis, component, deepest)`: what
  // it takes where the deepest basis has so many.
  using Room =
      std::function<std::size_t(std::size_t basis, std::size_t component, std::size_t deepest)>;
  Order(std::vector<std::vector<double>> squares, const NestedWhole& about, std::size_t means,
        const Room& room)
      : bases_(squares.size()), values_{means} {
    // rounding may leave a component longer than the one before it
    for (std::vector<double>& basis : squares) {
      for (std::size_t j = 1; j < basis.size(); ++j) basis[j] = std::min(basis[j], basis[j - 1]);
    }
    std::vector<std::size_t> ranks(bases_, 0);
    std::size_t deepest = 0;
    std::vector<double> gained;
    for (;;) {
      std::size_t best = bases_;
      double best_gain = -1;
      for (std::size_t b = 0; b < bases_; ++b) {
        if (ranks[b] == squares[b].size()) continue;
        const double gain = squares[b][ranks[b]] / static_cast<double>(room(b, ranks[b], deepest));
        if (gain > best_gain) {
          best_gain = gain;
          best = b;
        }
      }
      if (best == bases_) break;
      gained.push_back(squares[best][ranks[best]]);
      values_.push_back(values_.back() + room(best, ranks[best], deepest));
      taken_.push_back(static_cast<std::uint32_t>(best));
      deepest = std::max(deepest, ++ranks[best]);
    }
    errors_.assign(taken_.size() + 1, 0.0);
    double rest = about.residual_squares;
    for (std::size_t i = errors_.size(); i-- > 0;) {
      errors_[i] = about.squares > 0 ? std::sqrt(rest / about.squares) : 0;
      if (i > 0) rest += gained[i - 1];
    }
  }

  std::size_t count() const { return errors_.size(); }
  double error(std::size_t i) const { return errors_[i]; }
  std::size_t values(std::size_t i) const { return values_[i]; }
  std::vector<std::uint32_t> ranks(std::size_t i) const {
    std::vector<std::uint32_t> ranks(bases_, 0);
    for (std::size_t j = 0; j < i; ++j) ++ranks[taken_[j]];
    return ranks;
  }

 private:
  std::size_t bases_;
  std::vector<std::uint32_t> taken_;  // the basis that each component is of
  std::vector<double> errors_;
  std::vector<std::size_t> values_;
};

template <typename M>
class NestedComponents final : public NestedModels {
 public:
  using Cut = std::function<std::unique_ptr<Model>(const M& whole, std::vector<std::uint32_t>)>;
  NestedComponents(std::unique_ptr<M> whole, Order order, std::string bound, Cut cut,
                   std::shared_ptr<const ModeSpectra> spectra = nullptr)
      : whole_(std::move(whole)),
        order_(std::move(order)),
        bound_(std::move(bound)),
        cut_(std::move(cut)),
        spectra_(std::move(spectra)) {}

  std::size_t count() const override { return order_.count(); }
  std::unique_ptr<Model> model(std::size_t i) const override {
    return cut_(*whole_, order_.ranks(i));
  }
  std::size_t values(std::size_t i) const override { return order_.values(i); }
  double error(std::size_t i) const override { return order_.error(i); }
  bool complete() const override { return !bound_.empty(); }
  std::string bound() const override { return bound_; }
  std::shared_ptr<const ModeSpectra> spectra() const override { return spectra_; }

 private:
  std::unique_ptr<M> whole_;
  Order order_;
  std::string bound_;
  Cut cut_;
  std::shared_ptr<const ModeSpectra> spectra_;
};

constexpr std::string_view kept_member = R"("kept":)";
constexpr std::string_view kept_rank_member = R"("kept_rank":)";

}  // namespace

std::unique_ptr<PcaModel> leading_components(const PcaModel& whole, std::size_t rank) {
  auto model = std::make_unique<PcaModel>();
  model->info = whole.info;
  model->info.parameters =
      fmt::format("{}{}{}}}", without_kept(whole.info.parameters, kept_member), kept_member, rank);
  model->rank = rank;
  model->mean = whole.mean;
  model->basis.assign(whole.basis.begin(),
                      whole.basis.begin() + static_cast<std::ptrdiff_t>(rank * whole.mean.size()));
  const std::size_t texels = whole.info.btf.shape.texels();
  model->coefficients.reserve(texels * rank);
  for (std::size_t p = 0; p < texels; ++p) {
    const auto row = whole.coefficients.begin() + static_cast<std::ptrdiff_t>(p * whole.rank);
    model->coefficients.insert(model->coefficients.end(), row,
                               row + static_cast<std::ptrdiff_t>(rank));
  }
  return model;
}

std::unique_ptr<ViewPcaModel> leading_components(const ViewPcaModel& whole,
                                                 const std::vector<std::uint32_t>& ranks) {
  const BtfShape& shape = whole.info.btf.shape;
  const std::size_t light_channels = shape.lights * shape.channels;
  const auto [least, most] = std::minmax_element(ranks.begin(), ranks.end());
  auto model = std::make_unique<ViewPcaModel>();
  model->info = whole.info;
  model->info.parameters =
      fmt::format("{}{}[{},{}]}}", without_kept(whole.info.parameters, kept_member), kept_member,
                  *least, *most);
  model->ranks = IndexTensor(ranks, *most + std::size_t{1});
  model->mean = whole.mean;
  const std::vector<std::size_t> offsets = whole.offsets();
  const auto take = [&](const std::vector<float>& from, std::size_t width, std::size_t v,
                        std::vector<float>& to) {
    const auto first = from.begin() + static_cast<std::ptrdiff_t>(offsets[v] * width);
    to.insert(to.end(), first, first + static_cast<std::ptrdiff_t>(ranks[v] * width));
  };
  for (std::size_t v = 0; v < shape.views; ++v) {
    take(whole.images, shape.texels(), v, model->images);
    take(whole.basis, light_channels, v, model->basis);
  }
  return model;
}

std::unique_ptr<LpcaModel> leading_components(const LpcaModel& whole,
                                              const std::vector<std::uint32_t>& ranks) {
  const BtfShape& shape = whole.info.btf.shape;
  const std::size_t n = shape.images() * shape.channels;
  auto model = std::make_unique<LpcaModel>();
  model->info = whole.info;
  model->rank = *std::max_element(ranks.begin(), ranks.end());
  model->info.parameters =
      fmt::format("{}{}{}}}", without_kept(whole.info.parameters, kept_rank_member),
                  kept_rank_member, model->rank);
  model->clusters = whole.clusters;
  model->ranks = IndexTensor(ranks, model->rank + 1);
  model->mean = whole.mean;
  const std::vector<std::size_t> offsets = whole.offsets();
  for (std::size_t g = 0; g < ranks.size(); ++g) {
    const auto first = whole.basis.begin() + static_cast<std::ptrdiff_t>(offsets[g] * n);
    model->basis.insert(model->basis.end(), first,
                        first + static_cast<std::ptrdiff_t>(ranks[g] * n));
  }
  model->coefficients.assign(shape.texels() * model->rank, 0.0f);
  for (std::size_t p = 0; p < shape.texels(); ++p) {
    std::copy_n(whole.coefficients.data() + p * whole.rank, ranks[whole.clusters[p]],
                model->coefficients.data() + p * model->rank);
  }
  return model;
}

std::unique_ptr<NestedModels> nested_components(std::unique_ptr<PcaModel> whole,
                                                const NestedWhole& about) {
  const std::size_t component = whole->mean.size() + whole->info.btf.shape.texels();
  Order order({row_squares(whole->basis, whole->mean.size())}, about, whole->mean.size(),
              [=](std::size_t, std::size_t, std::size_t) { return component; });
  return std::make_unique<NestedComponents<PcaModel>>(
      std::move(whole), std::move(order), about.bound,
      [](const PcaModel& model, const std::vector<std::uint32_t>& ranks) {
        return leading_components(model, ranks[0]);
      });
}

std::unique_ptr<NestedModels> nested_components(std::unique_ptr<ViewPcaModel> whole,
                                                const NestedWhole& about) {
  const BtfShape& shape = whole->info.btf.shape;
  const std::vector<double> rows = row_squares(whole->basis, shape.lights * shape.channels);
  const std::vector<std::size_t> offsets = whole->offsets();
  std::vector<std::vector<double>> squares;
  for (std::size_t v = 0; v < shape.views; ++v) {
    squares.emplace_back(rows.begin() + static_cast<std::ptrdiff_t>(offsets[v]),
                         rows.begin() + static_cast<std::ptrdiff_t>(offsets[v + 1]));
  }
  // all components are of one size
  const std::size_t component = shape.texels() + shape.lights * shape.channels;
  Order order(std::move(squares), about, whole->mean.size(),
              [=](std::size_t, std::size_t, std::size_t) { return component; });
  return std::make_unique<NestedComponents<ViewPcaModel>>(
      std::move(whole), std::move(order), about.bound,
      [](const ViewPcaModel& model, const std::vector<std::uint32_t>& ranks) {
        return leading_components(model, ranks);
      });
}

std::unique_ptr<NestedModels> nested_components(std::unique_ptr<LpcaModel> whole,
                                                const NestedWhole& about) {
  const BtfShape& shape = whole->info.btf.shape;
  const std::size_t n = shape.images() * shape.channels;
  const std::vector<double> rows = row_squares(whole->basis, n);
  const std::vector<std::size_t> offsets = whole->offsets();
  std::vector<std::vector<double>> squares;
  for (std::size_t g = 0; g + 1 < offsets.size(); ++g) {
    squares.emplace_back(rows.begin() + static_cast<std::ptrdiff_t>(offsets[g]),
                         rows.begin() + static_cast<std::ptrdiff_t>(offsets[g + 1]));
  }
  // what is left with so many components of every cluster, from none on
  std::vector<double> left(whole->rank + 1, about.residual_squares);
  for (const std::vector<double>& basis : squares) {
    double rest = 0;
    for (std::size_t j = basis.size(); j-- > 0;) {
      rest += basis[j];
      left[j] += rest;
    }
  }
  // every texel has as many coefficients as the deepest cluster has components
  const std::size_t column = shape.texels();
  Order order(std::move(squares), about, whole->mean.size(),
              [=](std::size_t, std::size_t component, std::size_t deepest) {
                return component < deepest ? n : n + column;
              });
  return std::make_unique<NestedComponents<LpcaModel>>(
      std::move(whole), std::move(order), about.bound,
      [](const LpcaModel& model, const std::vector<std::uint32_t>& ranks) {
        return leading_components(model, ranks);
      },
      std::make_shared<const ModeSpectra>(ModeSpectra{std::move(left)}));
}

}  // namespace weft
