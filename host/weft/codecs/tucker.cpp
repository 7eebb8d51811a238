#include "weft/codecs/tucker.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "weft/codecs/fit_tucker.hpp"
#include "weft/codecs/nested_models.hpp"
#include "weft/codecs/rank_options.hpp"
#include "weft/codecs/tucker_decoder.hpp"
#include "weft/codecs/tucker_options.hpp"
#include "weft/codecs/tucker_plan.hpp"
#include "weft/codecs/tucker_sampler.hpp"
#include "weft/error.hpp"
#include "weft/model/kcta_parts.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/tucker.hpp"
#include "weft/model/tucker_parts.hpp"
#include "weft/ops/launch.hpp"
#include "weft/reference/tucker.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

const TuckerModel& as_tucker(const Model& model) {
  return dynamic_cast<const TuckerModel&>(model);
}

// What the encoder says of itself, with room: a file's size shall not depend on the digits of its
// errors or on how its goal was written.
std::string with_room(std::string parameters) {
  constexpr std::size_t room = 768;
  // a quote takes two bytes in the file's header
  const auto quotes = std::count(parameters.begin(), parameters.end(), '"');
  const std::size_t bytes = parameters.size() + static_cast<std::size_t>(quotes);
  parameters.insert(parameters.size() - 1, room - bytes % room, ' ');
  return parameters;
}

// Of the measured errors, which the file will hold as well.
constexpr std::size_t errors_room = 256;

// TuckerRequest::header: what a file takes beside core and factors.
auto header_of(const TuckerRequest& request, const BtfInfo& source) {
  const auto outline = std::make_shared<TuckerModel>();
  outline->info.codec = "tucker";
  outline->info.parameters = with_room("{}");
  outline->info.storage = request.storage;
  outline->info.btf = source;
  outline->set_groups(request.groups);
  TuckerRequest plain = request;
  plain.header = nullptr;
  return [outline, plain](std::span<const std::size_t> ranks,
                          std::span<const std::uint8_t> factors) {
    const TuckerBytes bytes = tucker_bytes(plain, factors);
    outline->ranks.assign(ranks.begin(), ranks.end());
    outline->core = FloatStore(product(ranks));
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      const std::size_t size = bytes.sizes[n];
      const bool whole = size <= short_mode && ranks[n] == size;
      outline->factors[n].resize(factors[n] != 0 && !whole ? size * ranks[n] : 0);
    }
    return model_file_size(*outline) + errors_room - static_cast<std::size_t>(bytes.numbers(ranks));
  };
}

class TuckerReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit TuckerReferenceDecoder(const TuckerModel& model) : model_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    reference::decode_tucker(model_, first, count, out);
  }

 private:
  const TuckerModel& model_;
};

// Models cut of one whose factors are orthonormal, at foreseen errors in equal steps of decibels.
class NestedTucker final : public NestedModels {
 public:
  NestedTucker(TuckerFit fit, const TuckerRequest& request)
      : fit_(std::move(fit)), request_(request) {
    request_.bytes = 0;
    lost_ = std::max(0.0, fit_.errors.squares - fit_.errors.core_squares);
    least_ = fit_.errors.squares > 0 ? std::sqrt(lost_ / fit_.errors.squares) : 1.0;
    largest_ = fit_.model->ranks;
    // of zeros nothing is lost
    for (std::size_t n = 0; n < largest_.size() && fit_.errors.squares == 0; ++n) {
      if (fit_.model->has_factor(n)) largest_[n] = 1;
    }
    const double decibels = -20 * std::log10(std::max(least_, finest));
    steps_ = static_cast<std::size_t>(std::ceil(decibels / step));
  }

  // The last is the whole.
  std::size_t count() const override { return steps_ + 1; }

  std::unique_ptr<Model> model(std::size_t i) const override {
    std::unique_ptr<TuckerModel> model = leading_model(*fit_.model, ranks(i));
    model->info = fit_.model->info;
    restate_ranks(*model);
    model->info.parameters = with_room(model->info.parameters);
    return model;
  }

  std::size_t values(std::size_t i) const override {
    const std::vector<std::size_t>& kept = ranks(i);
    std::size_t sum = product(std::span(kept));
    for (std::size_t n = 0; n < kept.size(); ++n) {
      if (fit_.model->has_factor(n)) sum += fit_.model->groups.groups()[n].size * kept[n];
    }
    return sum;
  }

  double error(std::size_t i) const override {
    return i < steps_ ? std::pow(10.0, -static_cast<double>(i) * step / 20) : least_;
  }

  bool complete() const override {
    if (fit_.errors.squares == 0) return true;
    for (std::size_t n = 0; n < request_.most.size(); ++n) {
      if (fit_.model->ranks[n] < request_.most[n]) return false;
    }
    return true;
  }

  std::string bound() const override {
    std::string given;
    for (std::size_t n = 0; n < request_.most.size(); ++n) {
      const ModeGroup& group = request_.groups.groups()[n];
      if (request_.most[n] >= group.size || fit_.model->ranks[n] < request_.most[n]) continue;
      given += fmt::format("{}{}={}", given.empty() ? "" : ",", group.name, request_.most[n]);
    }
    return given.empty() ? "all that float arithmetic resolves" : "the ranks given, " + given;
  }

 private:
  static constexpr double step = 0.02;    // dB
  static constexpr double finest = 1e-6;  // of the errors that are told apart

  const std::vector<std::size_t>& ranks(std::size_t i) const {
    if (i == steps_) return largest_;
    const auto [found, made] = ranks_.try_emplace(i);
    if (made) {
      TuckerRequest request = request_;
      request.relative = error(i);
      found->second = ranks_to_goal(*fit_.model, request, fit_.errors.squares, lost_).ranks;
    }
    return found->second;
  }

  TuckerFit fit_;
  TuckerRequest request_;
  double lost_ = 0;   // |D|^2 - |Z|^2
  double least_ = 0;  // the same as a relative error
  std::size_t steps_ = 0;
  std::vector<std::size_t> largest_;
  mutable std::map<std::size_t, std::vector<std::size_t>> ranks_;  // that were asked for
};

class TuckerCodec final : public Codec {
 public:
  std::string_view name() const override { return "tucker"; }
  std::string_view summary() const override {
    return "N-mode SVD: a core and a factor per mode, as TensorTextures";
  }
  bool separates_texels(const Parameters& parameters, const BtfShape& shape) const override {
    const auto merge = parameters.find("merge");
    const ModeGroups groups(shape, merge == parameters.end() ? "" : merge->second);
    return groups.group_of(Mode::row) != groups.group_of(Mode::column);
  }
  std::span<const ParameterSpec> parameters() const override { return tucker_parameters; }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    const TuckerOptions options =
        tucker_options(*this, parameters, source.info(), {}, storage, &device);
    ops::require_arithmetic(device, options.gram);
    job.plan(plan_tucker(device, source, options, job));
    return finish(fit_tucker(device, source, options, job), options, source.info(), job);
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    const TuckerOptions options =
        tucker_options(*this, parameters, source.info(), {}, storage, nullptr);
    return finish(reference::encode_tucker(source, options.request, job), options, source.info(),
                  job);
  }

  // Ranks that are given are the most.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    const BtfInfo& info = source.info();
    FitGoal goal;
    // float, so that the error is that of the factors before they are rounded
    Storage storage = Storage::f32;
    if (request.relative > 0) {
      constexpr double loosest = 0.999;
      goal.kind = FitGoal::Kind::relative;
      goal.relative = std::min(request.relative, loosest);
      goal.text = fmt::format("rel={}", goal.relative);
    } else {
      storage = request.storage;
      const double bytes = static_cast<double>(request.values) *
                           (storage == Storage::f16 ? 2.0 : 4.0) * request.growth;
      goal.kind = FitGoal::Kind::size;
      goal.bytes = std::max<std::size_t>(static_cast<std::size_t>(bytes), 1);
    }
    TuckerOptions options = tucker_options(*this, parameters, info, goal, storage, device);
    options.request.header = header_of(options.request, info);
    TuckerFit fit;
    if (device) {
      ops::require_arithmetic(*device, options.gram);
      job.plan(plan_tucker(*device, source, options, job));
      fit = fit_tucker(*device, source, options, job);
    } else {
      fit = reference::encode_tucker(source, options.request, job);
    }
    options.request.storage = request.storage;
    describe(fit, options, info, job);
    return std::make_unique<NestedTucker>(std::move(fit), options.request);
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_tucker(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return tucker_decoder(device, as_tucker(model));
  }
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    return tucker_decoder_bytes(as_tucker(model));
  }
  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<TuckerReferenceDecoder>(as_tucker(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return tucker_sampler(device, as_tucker(model));
  }
  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return tucker_sampler_bytes(as_tucker(model));
  }

  // A value is sum Z(r) prod u_n(r_n); in any order of float contractions the error is at most
  // gamma(t) sum |Z| prod |u_n|, t the roundings of all, and that at most |Z'| prod |u_n| by
  // Cauchy-Schwarz, Z' the part of the core that the modes without factors leave, and of those with
  // a factor all.
  double fitted_tolerance(const Model& model) const override {
    const TuckerModel& tucker = as_tucker(model);
    double terms = 1;
    double bound = largest_slice(tucker);
    for (std::size_t n = 0; n < tucker.groups.count(); ++n) {
      if (!tucker.has_factor(n)) continue;
      const std::size_t rank = tucker.ranks[n];
      double largest = 0;
      for (std::size_t i = 0; i < tucker.factors[n].size(); i += rank) {
        double square = 0;
        for (std::size_t r = 0; r < rank; ++r) {
          square += double{tucker.factors[n][i + r]} * double{tucker.factors[n][i + r]};
        }
        largest = std::max(largest, square);
      }
      bound *= std::sqrt(largest);
      terms += static_cast<double>(rank) + 2 * std::ceil(static_cast<double>(rank) / 96) + 3;
    }
    constexpr double unit = 0x1p-24;
    return terms * unit / (1 - terms * unit) * bound + terms * 0x1p-149;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override {
    return TuckerModel::read(file);
  }

 private:
  // Largest norm of what is left of the core when modes without a factor have an index each.
  static double largest_slice(const TuckerModel& model) {
    std::vector<std::size_t> strides(model.ranks.size(), 0);  // among slices; 0: summed over
    std::size_t slices = 1;
    for (std::size_t n = model.ranks.size(); n-- > 0;) {
      if (model.has_factor(n)) continue;
      strides[n] = slices;
      slices *= model.ranks[n];
    }
    std::vector<double> squares(slices, 0.0);
    std::vector<std::size_t> index(model.ranks.size(), 0);
    std::size_t slice = 0;
    for (const float value : model.core) {
      squares[slice] += double{value} * double{value};
      for (std::size_t n = index.size(); n-- > 0;) {
        slice += strides[n];
        if (++index[n] < model.ranks[n]) break;
        slice -= strides[n] * model.ranks[n];
        index[n] = 0;
      }
    }
    return std::sqrt(*std::max_element(squares.begin(), squares.end()));
  }

  std::unique_ptr<Model> finish(TuckerFit fit, const TuckerOptions& options, const BtfInfo& source,
                                Job& job) const {
    describe(fit, options, source, job);
    round_to_storage(*fit.model);
    return std::move(fit.model);
  }

  // sqrt(|D|^2 - |Z|^2) / |D|: what orthonormal factors lose.
  static double factors_error(const TuckerFit& fit) {
    const double squares = fit.errors.squares > 0 ? fit.errors.squares : 1;
    return std::sqrt(std::max(0.0, fit.errors.squares - fit.errors.core_squares) / squares);
  }

  // The model's info, and what the report says.
  void describe(const TuckerFit& fit, const TuckerOptions& options, const BtfInfo& source,
                Job& job) const {
    const TuckerRequest& request = options.request;
    TuckerModel& model = *fit.model;
    model.info.codec = name();
    model.info.storage = request.storage;
    model.info.btf = source;
    const double squares = fit.errors.squares > 0 ? fit.errors.squares : 1;
    const double factors = factors_error(fit);
    std::string errors = fmt::format("\"factors_error\":{:.6g}", factors);
    const bool iterates = request.method == TuckerMethod::hooi;
    if (request.method == TuckerMethod::hosvd) {
      errors += fmt::format(",\"error_bound\":{:.6g}", std::sqrt(fit.errors.bound / squares));
    } else if (!iterates) {
      errors += fmt::format(",\"discarded\":{:.6g}", std::sqrt(fit.errors.discarded / squares));
    }
    std::string how(name_of(request.method));
    if (iterates) how += fmt::format(" ({} from {})", request.iterations, name_of(request.start));
    model.info.parameters = with_room(fmt::format(
        R"({{"merge":"{}","method":"{}","start":"{}","iterations":{},"arithmetic":"{}",)"
        R"("ranks":{{{}}},"sizes":{{{}}},{}}})",
        request.groups.merge(), name_of(request.method), iterates ? name_of(request.start) : "",
        iterates ? request.iterations : 0, options.gram == Arithmetic::f64 ? "f64" : "f32",
        ranks_json(model.groups, model.ranks), ranks_json(model.groups, model.groups.sizes()),
        errors));
    job.notes.push_back(fmt::format("{}, ranks {}; |D|^2 - |Z|^2: relative error {:.6g}", how,
                                    ranks_json(model.groups, model.ranks), factors));
    if (request.method == TuckerMethod::hosvd && !request.has_goal()) {
      job.notes.push_back(fmt::format("bound of the relative error, eq. (4): {:.6g}",
                                      std::sqrt(fit.errors.bound / squares)));
    } else if (request.method == TuckerMethod::sthosvd) {
      job.notes.push_back(fmt::format("discarded singular values: relative error {:.6g}",
                                      std::sqrt(fit.errors.discarded / squares)));
    }
  }
};

}  // namespace

const Codec& tucker_codec() {
  static const TuckerCodec codec;
  return codec;
}

std::unique_ptr<Model> expand_modes(std::unique_ptr<Model> model, std::string_view modes) {
  if (modes.empty()) return model;
  if (const auto* kcta = dynamic_cast<const KctaModel*>(model.get())) return expanded(*kcta, modes);
  const auto* tucker = dynamic_cast<const TuckerModel*>(model.get());
  if (tucker == nullptr) {
    fail_input("--expand {}: a model of codec {} has no modes to expand", modes, model->info.codec);
  }
  return expanded(*tucker, modes);
}

}  // namespace weft
