#include "weft/codecs/tt.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "weft/codecs/fit_tt.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/nested_train.hpp"
#include "weft/codecs/tt_decoder.hpp"
#include "weft/codecs/tt_goal.hpp"
#include "weft/error.hpp"
#include "weft/ops/look_up_train.hpp"
#include "weft/ops/order_lookups.hpp"
#include "weft/reference/tt.hpp"

namespace weft {
namespace {

const TtModel& as_tt(const Model& model) {
  return dynamic_cast<const TtModel&>(model);
}

class TtDeviceSampler final : public DeviceSampler {
 public:
  TtDeviceSampler(Device& device, const TtModel& model)
      : device_(device),
        shape_(model.info.btf.shape),
        operations_(static_cast<double>(model.texel_operations())),
        cores_(device, model),
        order_(device, shape_.texels()) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, shape_);
    order_.for_each({lookup, shape_, count, lookups, out}, [&](const ops::LookupBatch& batch) {
      ops::look_up_train(device_, batch, cores_);
    });
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return operations_ *
           static_cast<double>(std::max({lookup.texels, lookup.views, lookup.lights}));
  }

 private:
  Device& device_;
  BtfShape shape_;
  double operations_;
  ops::TrainCores cores_;
  ops::TexelOrder order_;
};

class TtReferenceDecoder final : public ReferenceDecoder {
 public:
  explicit TtReferenceDecoder(const TtModel& model) : images_(model) {}
  void decode(std::size_t first, std::size_t count, std::span<double> out) override {
    images_.decode(first, count, out);
  }

 private:
  reference::TtImages images_;
};

// sqrt of |G|_inf of a Gram matrix G of a core's rows: at least the core's spectral norm.
double spectral_bound(const std::vector<float>& core, std::size_t rows) {
  const std::size_t columns = core.size() / rows;
  double largest = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    double sum = 0;
    for (std::size_t j = 0; j < rows; ++j) {
      double product = 0;
      for (std::size_t k = 0; k < columns; ++k) {
        product += double{core[i * columns + k]} * double{core[j * columns + k]};
      }
      sum += std::abs(product);
    }
    largest = std::max(largest, sum);
  }
  return std::sqrt(largest);
}

class TtCodec final : public Codec {
 public:
  std::string_view name() const override { return "tt"; }
  std::string_view summary() const override {
    return "tensor train: a chain of small cores, one per mode; fast single texels";
  }
  bool separates_texels(const Parameters&, const BtfShape&) const override { return true; }
  std::span<const ParameterSpec> parameters() const override {
    static constexpr std::array<ParameterSpec, 3> specs{{
        {"ranks", "", "R1,R2,R3,R4 of the bonds between the modes"},
        {"rank", "", "one rank for all bonds, or the most that one can have"},
        {"order", "x,y,c,v,l", "order of the modes x, y, c, v and l, or auto"},
    }};
    return specs;
  }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    TtOptions options = tt_options(*this, parameters, source.info());
    options = with_order(device, source, parameters, options, job);
    const FitTrain fit = planned_fit(device, source, options, job);
    return fit_to_goal(
        options, source.info(), storage, fit,
        [&](const TtModel& model) {
          const ErrorSums sums = measure_errors(device, *tt_decoder(device, model), source, job);
          return relative_error(sums);
        },
        job);
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    const BtfInfo& info = source.info();
    const TtOptions options = tt_options(*this, parameters, info);
    check_order(options);
    return fit_to_goal(
        options, info, storage,
        [&](const reference::TrainRequest& request) {
          return reference::encode_tt(source, options.order, request, job);
        },
        [&](const TtModel& model) {
          TtReferenceDecoder decoder(model);
          return relative_error(measure_errors(decoder, source, job));
        },
        job);
  }

  // Ranks that are given are the most.
  std::unique_ptr<NestedModels> nested(Device* device, TileSource& source,
                                       const Parameters& parameters, const NestedRequest& request,
                                       Job& job) const override {
    const BtfInfo& info = source.info();
    TtOptions options = tt_options(*this, parameters, info);
    options.goal = FitGoal();
    if (!device) {
      check_order(options);
      return nested_train(
          options, info, request,
          [&](const reference::TrainRequest& wanted) {
            return reference::encode_tt(source, options.order, wanted, job);
          },
          job);
    }
    options.goal.relative = request.relative;
    options = with_order(*device, source, parameters, options, job);
    options.goal = FitGoal();
    return nested_train(options, info, request, planned_fit(*device, source, options, job), job);
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_tt(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return tt_decoder(device, as_tt(model));
  }
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    return tt_decoder_bytes(as_tt(model));
  }
  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return std::make_unique<TtReferenceDecoder>(as_tt(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return std::make_unique<TtDeviceSampler>(device, as_tt(model));
  }
  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return ops::TrainCores::bytes(as_tt(model)) +
           ops::TexelOrder::most_bytes(model.info.btf.shape.texels());
  }
  std::unique_ptr<Model> fitted_mip_level(const Model& model) const override {
    return as_tt(model).next_mip_level();
  }

  // A product of R terms in float has an error of at most gamma_R |A|_F |B|_F, and
  // |B|_F <= sqrt(R) |B|_2; what it is multiplied with has the spectral norms of its slices. With
  // s_n at least the largest spectral norm of a slice of core n:
  //
  //   |error| <= sum_n gamma_{R_n} sqrt(R_n) prod_n s_n      gamma_R = R u / (1 - R u)
  double fitted_tolerance(const Model& model) const override {
    const TtModel& train = as_tt(model);
    double size = 1;
    double terms = 0;
    for (std::size_t n = 0; n < mode_count; ++n) {
      const std::vector<float>& core = train.cores[n];
      const std::size_t right = train.ranks[n + 1];
      // the largest Frobenius norm of a slice
      std::vector<double> squares(train.size(n), 0.0);
      for (std::size_t i = 0; i < core.size(); ++i) {
        squares[i / right % train.size(n)] += std::pow(double{core[i]}, 2);
      }
      double norm = std::sqrt(*std::max_element(squares.begin(), squares.end()));
      // or the spectral norm of all of it, where that is less
      norm = std::min(norm, spectral_bound(core, train.ranks[n]));
      if (n + 1 < mode_count) {
        std::vector<float> turned(core.size());
        const std::size_t rows = core.size() / right;
        for (std::size_t i = 0; i < rows; ++i) {
          for (std::size_t j = 0; j < right; ++j) turned[j * rows + i] = core[i * right + j];
        }
        norm = std::min(norm, spectral_bound(turned, right));
      }
      size *= norm;
      const double rank = static_cast<double>(right);
      terms += rank * 0x1p-24 / (1 - rank * 0x1p-24) * std::sqrt(rank);
    }
    // Each operation on subnormal values may round by half a step of 2^-149 beside.
    return terms * size + static_cast<double>(train.coefficients()) * 0x1p-149;
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override { return TtModel::read(file); }

 private:
  static void check_order(const TtOptions& options) {
    if (options.choose_order) {
      fail_input("--order auto: the reference takes an order as it is given");
    }
  }

  // With the order that is chosen for them, and what depends on it.
  TtOptions with_order(Device& device, TileSource& source, const Parameters& parameters,
                       const TtOptions& options, Job& job) const {
    if (!options.choose_order) return options;
    Parameters chosen = parameters;
    chosen["order"] = to_text(weft::choose_order(device, source, options, job));
    return tt_options(*this, chosen, source.info());
  }

  static FitTrain planned_fit(Device& device, TileSource& source, const TtOptions& options,
                              Job& job) {
    TtFitOptions fit;
    fit.order = options.order;
    fit.request.ranks = options.ranks;
    const bool tolerates = options.goal || options.ranks[0] == 0;
    fit.request.tolerance = tolerates ? 0.5 : 0;
    job.plan(plan_tt(device, source, fit, job));
    return [&device, &source, &job, fit](const reference::TrainRequest& request) mutable {
      fit.request = request;
      try {
        return fit_tt(device, source, fit, job);
      } catch (const Error& error) {
        // A cut speaks of its own part of the goal.
        if (error.kind() != ErrorKind::unmet_goal) throw;
        fail(ErrorKind::unmet_goal, "cutting the train to a relative error of {:.4g}: {}",
             request.tolerance, error.what());
      }
    };
  }

  static double relative_error(const ErrorSums& sums) {
    if (sums.square_difference == 0) return 0;
    return std::sqrt(sums.square_difference / sums.square_reference);
  }
};

}  // namespace

const Codec& tt_codec() {
  static const TtCodec codec;
  return codec;
}

namespace {

// The order of modes stays.
TtOptions rounding_options(const TtModel& model, const Parameters& parameters) {
  Parameters same_order = parameters;
  const auto asked = same_order.emplace("order", to_text(model.order)).first;
  if (asked->second != to_text(model.order)) {
    fail_input("--order {}: the train's order {} stays when it is rounded", asked->second,
               to_text(model.order));
  }
  return tt_options(tt_codec(), same_order, model.info.btf);
}

}  // namespace

std::unique_ptr<Model> round_tt(const TtModel& model, const Parameters& parameters, Storage storage,
                                Job& job) {
  const TtOptions options = rounding_options(model, parameters);
  const TensorTrain whole = reference::to_train(model);
  const double squares = reference::tt_inner(whole, whole);
  const StageTimer timer(job, "TT-rounding");
  return fit_to_goal(
      options, model.info.btf, storage,
      [&](const reference::TrainRequest& request) { return reference::tt_round(whole, request); },
      [&](const TtModel& rounded) {
        const TensorTrain part = reference::to_train(rounded);
        const double rest =
            squares - 2 * reference::tt_inner(whole, part) + reference::tt_inner(part, part);
        return squares > 0 ? std::sqrt(std::max(rest, 0.0) / squares) : 0.0;
      },
      job);
}

std::unique_ptr<NestedModels> nested_train(const TtModel& model, const Parameters& parameters,
                                           Storage storage, Job& job) {
  const StageTimer timer(job, "TT-rounding");
  NestedTrain train;
  train.options = rounding_options(model, parameters);
  train.options.goal = FitGoal();
  train.info = model.info.btf;
  train.storage = storage;
  reference::TrainRequest most;
  most.ranks = train.options.ranks;
  train.fit = reference::tt_round(reference::to_train(model), most);
  train.complete = true;
  train.bound = "the train that is cut";
  return nested_train(std::move(train));
}

}  // namespace weft
