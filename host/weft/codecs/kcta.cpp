#include "weft/codecs/kcta.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "weft/codecs/fit_kcta.hpp"
#include "weft/codecs/fit_tucker.hpp"
#include "weft/codecs/kcta_decoder.hpp"
#include "weft/codecs/kcta_options.hpp"
#include "weft/codecs/kcta_plan.hpp"
#include "weft/codecs/kcta_sampler.hpp"
#include "weft/codecs/nested_kcta.hpp"
#include "weft/codecs/rank_options.hpp"
#include "weft/codecs/refit_kcta.hpp"
#include "weft/model/kcta.hpp"
#include "weft/model/storage.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {
namespace {

const KctaModel& as_kcta(const Model& model) {
  return dynamic_cast<const KctaModel&>(model);
}

class KctaReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit KctaReferenceDecoder(const KctaModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_kcta(model_, first, count, out);
  }

 private:
  const KctaModel& model_;
};

// The largest norm of a row of a factor [rows][rank]; 1 for an identity.
double largest_row(std::span<const float> factor, std::size_t rank) {
  if (factor.empty()) return 1;
  double largest = 0;
  for (std::size_t i = 0; i < factor.size(); i += rank) {
    double square = 0;
    for (std::size_t r = 0; r < rank; ++r) square += double{factor[i + r]} * double{factor[i + r]};
    largest = std::max(largest, square);
  }
  return std::sqrt(largest);
}

class KctaCodec final : public Codec {
 public:
  explicit KctaCodec(bool mixes) : mixes_(mixes) {}

  std::string_view name() const override { return mixes_ ? "kcta" : "cta"; }
  std::string_view summary() const override {
    return mixes_ ? "clusters of slices, each a core and factors, mixed for each slice"
                  : "clusters of slices, each a core and factors";
  }
  bool separates_texels(const Parameters& parameters, const BtfShape& shape) const override {
    const std::string_view merge = value_of(*this, parameters, "merge");
    const ModeGroups groups(shape, merge == "none" ? std::string_view() : merge);
    return groups.group_of(Mode::row) != groups.group_of(Mode::column);
  }
  std::span<const ParameterSpec> parameters() const override {
    return std::span(kcta_parameters).first(kcta_parameters.size() - (mixes_ ? 0 : 1));
  }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    KctaRequest request = kcta_options(*this, parameters, source.info());
    const std::vector<std::size_t> modes = modes_to_choose(*this, parameters, source.info());
    if (!modes.empty()) {
      request = kcta_options(*this, parameters, source.info(),
                             mode_spectra(device, source, request.groups, modes, job));
    }
    job.plan(plan_kcta(device, source, request, job));
    return finish(fit_kcta(device, source, request, job), request, source.info(), storage, job);
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    KctaRequest request = kcta_options(*this, parameters, source.info());
    const std::vector<std::size_t> modes = modes_to_choose(*this, parameters, source.info());
    if (!modes.empty()) {
      request = kcta_options(*this, parameters, source.info(),
                             reference::mode_spectra(source, request.groups, modes, job));
    }
    return finish(reference::encode_kcta(source, request, job), request, source.info(), storage,
                  job);
  }

  bool takes_goals() const override { return true; }

  // Ranks that are given are the most, and clusters as many as are given.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    const BtfInfo& info = source.info();
    std::shared_ptr<const ModeSpectra> spectra = request.spectra;
    if (!spectra) {
      const std::vector<std::size_t> modes = modes_of_goal(*this, parameters, info);
      const ModeGroups groups = kcta_options(*this, parameters, info, {}, KctaGoal()).groups;
      spectra = std::make_shared<const ModeSpectra>(
          device ? mode_spectra(*device, source, groups, modes, job)
                 : reference::mode_spectra(source, groups, modes, job));
    }
    const auto asked = [&](const KctaGoal& goal) {
      return kcta_options(*this, parameters, info, *spectra, goal);
    };
    KctaGoal goal;
    goal.threshold = request.relative > 0 ? threshold_of_error(request.relative)
                                          : threshold_of_numbers(request, asked);
    goal.growth = request.relative > 0 ? request.growth : 1;
    const KctaRequest wanted = asked(goal);
    const KctaRequest largest = asked({0, static_cast<double>(info.shape.values())});
    if (device) job.plan(plan_kcta(*device, source, wanted, job));
    const std::unique_ptr<KctaEncoder> encoder = device
                                                     ? kcta_encoder(*device, source, wanted, job)
                                                     : reference::kcta_encoder(source, wanted, job);
    const auto nest = [&](KctaFit fit, std::size_t fits) {
      note_errors(fit, job);
      NestedClusters made;
      made.fit = std::move(fit);
      ModelInfo& model = made.fit.model->info;
      model.codec = name();
      model.storage = request.storage;
      model.btf = info;
      made.global = wanted.global_mode;
      made.align = count_parameter(*this, parameters, "align", 1);
      const bool whole = made.fit.model->ranks == largest.ranks;
      if (whole && wanted.clusters == largest.clusters) {
        made.bound = kcta_bounds(*this, parameters, largest);
      }
      made.spectra = spectra;
      made.decompositions = fits;
      made.parameters = [wanted](const KctaModel& cut, double error) {
        return parameters_of(cut, wanted, error);
      };
      return nested_clusters(std::move(made));
    };
    std::unique_ptr<NestedModels> whole = nest(encoder->fit(), 1);
    if (wanted.mixtures == 1) return whole;
    return refitted(std::move(whole), *encoder, request, wanted.iterations, nest);
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_kcta(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return kcta_decoder(device, as_kcta(model));
  }
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    return kcta_decoder_bytes(as_kcta(model));
  }
  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<KctaReferenceDecoder>(as_kcta(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return kcta_sampler(device, as_kcta(model));
  }
  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return kcta_sampler_bytes(as_kcta(model));
  }

  // A value is a sum over its clusters of sum Z_c(r) prod u_n,c(r_n); in any order of float
  // contractions the error is at most gamma(t) sum |Z_c| prod |u_n,c|, t the roundings of all, and
  // that at most |Z_c| prod |u_n,c| by Cauchy-Schwarz, summed over the clusters of the slice for
  // which that is most.
  double fitted_tolerance(const Model& model) const override {
    const KctaModel& kcta = as_kcta(model);
    const auto roundings = [](std::size_t rank) {
      return static_cast<double>(rank) + 2 * std::ceil(static_cast<double>(rank) / 96) + 3;
    };
    double terms = 1 + roundings(kcta.clusters * kcta.ranks[kcta.mode]);
    for (std::size_t n = 0; n < kcta.groups.count(); ++n) {
      if (n != kcta.mode && kcta.has_factor(n)) terms += roundings(kcta.ranks[n]);
    }
    std::vector<double> bounds(kcta.clusters);
    const std::size_t core = kcta.cores.size() / kcta.clusters;
    for (std::size_t c = 0; c < kcta.clusters; ++c) {
      double squares = 0;
      for (const float value : std::span(kcta.cores).subspan(c * core, core)) {
        squares += double{value} * double{value};
      }
      bounds[c] = std::sqrt(squares);
      for (std::size_t n = 0; n < kcta.groups.count(); ++n) {
        if (n != kcta.mode) bounds[c] *= largest_row(kcta.factor(n, c), kcta.ranks[n]);
      }
    }
    double bound = 0;
    for (std::size_t i = 0; i < kcta.all_slices(); ++i) {
      double sum = 0;
      for (std::size_t k = 0; k < kcta.mixtures; ++k) {
        const std::span<const float> row = kcta.mixing_row(i, k);
        sum += bounds[kcta.member(i, k)] * largest_row(row, row.size());
      }
      bound = std::max(bound, sum);
    }
    constexpr double unit = 0x1p-24;
    return terms * unit / (1 - terms * unit) * bound + terms * 0x1p-149;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override {
    return KctaModel::read(file);
  }

 private:
  // What each of the four modes may lose by itself where all of them may lose this, with room for
  // ranks that are then traded for one another.
  static double threshold_of_error(double relative) {
    constexpr double of_error = 0.4;
    return of_error * relative;
  }

  // The loosest threshold whose model is larger than is wanted, so that it can be cut back.
  template <typename Asked>
  static double threshold_of_numbers(const NestedRequest& request, const Asked& asked) {
    constexpr double of_values = 1.5;
    constexpr int halvings = 30;
    const double wanted = of_values * request.growth * static_cast<double>(request.values);
    double loose = 0;  // base 2 logarithms
    double tight = -20;
    for (int i = 0; i < halvings; ++i) {
      const double middle = (loose + tight) / 2;
      const bool large = clustered_numbers(asked({std::exp2(middle), 1})) >= wanted;
      (large ? tight : loose) = middle;
    }
    return std::exp2(tight);
  }

  static void note_errors(const KctaFit& fit, Job& job) {
    const double squares = fit.errors.squares > 0 ? fit.errors.squares : 1;
    std::string errors;
    for (const double left : fit.errors.history) {
      errors += fmt::format("{}{:.6g}", errors.empty() ? "" : ", ",
                            std::sqrt((fit.errors.lost + left) / squares));
    }
    job.notes.push_back(fmt::format("relative error of the factors, by iterations: {}{}", errors,
                                    fit.errors.restored ? ", the last given up" : ""));
  }

  static std::string parameters_of(const KctaModel& model, const KctaRequest& request,
                                   double error) {
    std::string global;
    for (std::size_t n = 0; n < model.groups.count(); ++n) {
      const ModeGroup& group = model.groups.groups()[n];
      if (n == model.mode || model.ranks[n] == group.size || request.global_mode[n] == 0) continue;
      global += (global.empty() ? "" : ",") + group.name;
    }
    return fmt::format(
        R"({{"merge":"{}","mode":"{}","clusters":{},"mixtures":{},"ranks":{{{}}},"sizes":{{{}}},)"
        R"("global":"{}","init":"{}","iterations":{},"resample_views":{},"factors_error":{:.6g}}})",
        model.groups.merge(), model.groups.groups()[model.mode].name, model.clusters,
        model.mixtures, ranks_json(model.groups, model.ranks),
        ranks_json(model.groups, model.groups.sizes()), global, name_of(request.start),
        request.iterations, model.grid_side, error);
  }

  std::unique_ptr<Model> finish(KctaFit fit, const KctaRequest& request, const BtfInfo& source,
                                Storage storage, Job& job) const {
    KctaModel& model = *fit.model;
    model.info.codec = name();
    model.info.storage = storage;
    model.info.btf = source;
    const double squares = fit.errors.squares > 0 ? fit.errors.squares : 1;
    model.info.parameters = parameters_of(
        model, request, std::sqrt((fit.errors.lost + fit.errors.history.back()) / squares));
    note_errors(fit, job);
    round_to_storage(model);
    return std::move(fit.model);
  }

  bool mixes_;
};

}  // namespace

const Codec& kcta_codec() {
  static const KctaCodec codec(true);
  return codec;
}

const Codec& cta_codec() {
  static const KctaCodec codec(false);
  return codec;
}

}  // namespace weft
