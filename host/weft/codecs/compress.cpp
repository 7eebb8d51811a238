#include "weft/codecs/compress.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "weft/btf/relabelled_source.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/measure_log.hpp"
#include "weft/codecs/meet_goal.hpp"
#include "weft/codecs/occlusion.hpp"
#include "weft/codecs/store_model.hpp"
#include "weft/codecs/tt.hpp"
#include "weft/codecs/weighted_fit.hpp"
#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// What is said of a source whose mask has a model of its own.
BtfInfo without_mask(BtfInfo info) {
  info.mask.clear();
  info.mask_distance.clear();
  return info;
}

// What of the source is fitted.
ColourTransform colour_transform(TileSource& source, const CompressRequest& request, Job& job) {
  if (!request.train) return choose_colour_transform(source, request.colour, job);
  if (request.colour.kind != ColourTransform::Kind::none || !request.colour.weights.empty()) {
    fail_input("--transform {}: a train that is cut further keeps its own, {}",
               name_of(request.colour.kind), name_of(request.train->info.colour_transform.kind));
  }
  return request.train->info.colour_transform;
}

// The source, and what is fitted instead of it: transformed, then weighted.
class Prepared {
 public:
  Prepared(TileSource& source, const CompressRequest& request, Job& job)
      : source_(source),
        request_(request),
        transform_(colour_transform(source, request, job)),
        transformed_(source, transform_, job.nan_zero) {
    TileSource& fitted = transform_.is_identity() ? source : transformed_;
    fitted_ = &fitted;
    if (request.weights.all_equal()) return;
    weighted_ = std::make_unique<WeightedFit>(*request.codec, request.parameters, fitted,
                                              request.weights, job);
    fitted_ = &weighted_->source();
  }

  TileSource& source() const { return source_; }
  TileSource& fitted() const { return *fitted_; }
  bool is_source() const { return fitted_ == &source_; }
  // What encoders round to: weights are divided out of what is not rounded yet.
  Storage encoded_storage() const { return weighted_ ? Storage::f32 : request_.storage.fitted(); }

  // Makes a model of what was fitted one of the source.
  void undo(Model& model) const {
    if (weighted_) weighted_->undo(model);
    describe(model);
  }

 private:
  // What the model says of its making.
  void describe(Model& model) const {
    ModelInfo& info = model.info;
    info.colour_transform = transform_;
    // a transformed source is F32
    if (!request_.train) info.btf.dtype = source_.info().dtype;
    info.selection = request_.train ? request_.train->info.selection : request_.selection;
    info.weights = request_.weights_json;
    info.occlusion = request_.occlusion;
    info.program_version = version();
    if (!request_.goal) return;
    // a member of the object that is there
    std::string& parameters = info.parameters;
    const std::size_t end = parameters.rfind('}');
    const bool empty = parameters.find('"') == std::string::npos;
    parameters.insert(end, fmt::format("{}\"goal\":\"{}\"", empty ? "" : ",", request_.goal.text));
  }

  TileSource& source_;
  const CompressRequest& request_;
  ColourTransform transform_;
  TransformedSource transformed_;
  std::unique_ptr<WeightedFit> weighted_;
  TileSource* fitted_ = nullptr;
};

// A model of what is fitted, as the codec rounds it.
std::unique_ptr<Model> fit(Device* device, const Prepared& prepared, const CompressRequest& request,
                           const Parameters& parameters, Job& job) {
  if (request.train) return round_tt(*request.train, parameters, request.storage.fitted(), job);
  const Codec& codec = *request.codec;
  const Storage storage = prepared.encoded_storage();
  return device ? codec.encode(*device, prepared.fitted(), parameters, storage, job)
                : codec.encode_reference(prepared.fitted(), parameters, storage, job);
}

// A decomposition that a goal's models are cut of.
std::unique_ptr<NestedModels> decompose(Device* device, const Prepared& prepared,
                                        const CompressRequest& request, const NestedRequest& wanted,
                                        Job& job) {
  if (!request.train) {
    return request.codec->nested(device, prepared.fitted(), request.parameters, wanted, job);
  }
  return nested_train(*request.train, request.parameters, wanted.storage, job);
}

// Errors of the stored model against the source.
MeasuredModel measure(Device* device, TileSource& source, const CompressRequest& request,
                      const Model& model, Job& job) {
  const bool ssim = request.ssim || request.goal.kind == GoalKind::ssim;
  SimilarityRequest similarity{request.peak, {}};
  SimilarityRequest* const wanted = ssim ? &similarity : nullptr;
  const Codec& codec = *request.codec;
  WeightedErrors weighted{request.weights, {}};
  WeightedErrors* const weighs = request.weights_json.empty() ? nullptr : &weighted;
  const ErrorSums sums =
      device ? measure_errors(*device, *codec.decoder(*device, model), source, job, wanted, weighs)
             : measure_errors(*codec.reference_decoder(model), source, job, wanted, weighs);
  const double peak = request.peak > 0 ? request.peak : psnr_peak(source.info(), sums);
  MeasuredModel measured;
  measured.errors = report(sums, peak);
  if (weighs) measured.errors.weighted = weighted_report(weighted.sums, peak);
  if (ssim) {
    measured.errors.ssim = similarity.sums.mean();
    measured.lowest_ssim = similarity.sums.lowest;
  }
  return measured;
}

// On a logarithmic scale too, where that is asked for or what was fitted.
void add_log_errors(Device* device, TileSource& source, const CompressRequest& request,
                    const Model& model, Job& job, ErrorReport& errors) {
  const ColourTransform& transform = model.info.colour_transform;
  if (!request.log_error && transform.is_linear()) return;
  LogErrorRequest log;
  log.scale = transform.is_linear() ? mean_magnitude(source, job) : transform.scale;
  measure_log_errors(device, model, source, log, job);
  errors.log = report(log.sums, log.scale);
}

// Bytes of a number, about: with steps as coarse as a size makes them, few.
double value_bytes(const StorageRequest& storage, bool by_size) {
  switch (storage.kind) {
    case StorageRequest::Kind::half:
      return 2;
    case StorageRequest::Kind::single:
      return 4;
    case StorageRequest::Kind::bits:
      return storage.bits / 8.0;
    case StorageRequest::Kind::automatic:
      return by_size ? 0.25 : 1;
  }
  return 2;
}

// A codec's own goal, "rel=EPS" or "size=BYTES", for the values alone where a model of the mask is
// a part of the file.
std::string without_mask(const std::string& target, const CompressRequest& request) {
  constexpr std::string_view size = "size=";
  if (!request.occlusion || !target.starts_with(size)) return target;
  const double bytes = std::stod(target.substr(size.size()));
  const auto mask = static_cast<double>(occlusion_file_size(*request.occlusion));
  return fmt::format("size={:.0f}", std::max(bytes - mask, 1.0));
}

// The model that meets the request's goal.
GoalResult meet(Device* device, const Prepared& prepared, const CompressRequest& request,
                Job& job) {
  TileSource& source = prepared.source();
  WeightedErrors weighted{request.weights, {}};
  WeightedErrors* const weighs = request.weights_json.empty() ? nullptr : &weighted;
  const ErrorSums sums = sums_of(device, source, job, weighs);
  const ErrorSums& of_goal = weighs ? weighted.sums : sums;
  GoalSource about;
  about.bytes = source.info().bytes();
  about.squares = prepared.is_source() ? sums.square_reference
                                       : sums_of(device, prepared.fitted(), job).square_reference;
  about.root_mean_square =
      std::sqrt(of_goal.square_reference / static_cast<double>(source.info().shape.values()));
  about.peak = request.peak > 0 ? request.peak : psnr_peak(source.info(), sums);
  about.storage = request.storage.fitted();
  about.value_bytes = value_bytes(request.storage, request.goal.by_size());
  about.storing_bytes = storing_bytes(request.storage, 1);
  about.may_widen = request.may_widen;
  FileSizer sizer;
  double bytes_of_bit = 0.125;
  GoalSteps steps;
  steps.sizer = &sizer;
  steps.decompose = [&](const NestedRequest& wanted) {
    return decompose(device, prepared, request, wanted, job);
  };
  steps.encode = [&](const std::string& target) {
    Parameters parameters = request.parameters;
    parameters["target"] = without_mask(target, request);
    return fit(device, prepared, request, parameters, job);
  };
  StorageBound bound;
  bound.sizer = &sizer;
  if (weighs) bound.weights = &request.weights;
  steps.store = [&, bound](Model& model, Storage storage) {
    prepared.undo(model);
    set_storage(model, storage);
    StorageRequest as = request.storage;
    if (storage != as.fitted()) as.kind = StorageRequest::Kind::single;
    store_model(device, model, source, as, job, bound);
  };
  const double relative = request.goal.relative(about.root_mean_square, about.peak);
  if (request.storage.kind == StorageRequest::Kind::automatic && relative > 0) {
    constexpr double rounding = 1e-9;  // of the errors that are told from the squares
    bound.most_squares = relative * relative * of_goal.square_reference * (1 - rounding);
    steps.store_floats = [&](Model& model) {
      prepared.undo(model);
      set_storage(model, Storage::f32);
    };
    steps.store_to_goal = [&, bound](Model& model) {
      prepared.undo(model);
      store_model(device, model, source, request.storage, job, bound);
    };
  }
  if (request.storage.kind == StorageRequest::Kind::automatic && request.goal.by_size()) {
    bound.most_bytes = request.goal.bytes;
    bound.bytes_of_bit = &bytes_of_bit;
    steps.store_to_size = [&, bound](Model& model) {
      prepared.undo(model);
      return store_model(device, model, source, request.storage, job, bound);
    };
  }
  steps.measure = [&](const Model& model) { return measure(device, source, request, model, job); };
  return meet_goal(request.goal, about, steps, job);
}

}  // namespace

MeasuredModel measure_model(Device* device, TileSource& source, const CompressRequest& request,
                            const Model& model, Job& job) {
  MeasuredModel measured = measure(device, source, request, model, job);
  add_log_errors(device, source, request, model, job, measured.errors);
  return measured;
}

void check_parameters(const Codec& codec, const Parameters& parameters) {
  const auto specs = codec.parameters();
  for (const auto& given : parameters) {
    const bool known = std::any_of(specs.begin(), specs.end(), [&](const ParameterSpec& spec) {
      return spec.name == given.first;
    });
    if (!known) {
      fail_input("--{} {}: not a parameter of codec {}", given.first, given.second, codec.name());
    }
  }
}

CompressResult compress(Device* device, TileSource& source, const CompressRequest& request,
                        Job& job) {
  if (request.occlusion && !source.info().mask.empty()) {
    RelabelledSource unmasked(source, without_mask(source.info()));
    return compress(device, unmasked, request, job);
  }
  check_parameters(*request.codec, request.parameters);
  if (request.goal && !request.codec->takes_goals()) {
    fail_input("--target {}: codec {} takes no goals", request.goal.text, request.codec->name());
  }
  CompressResult result;
  const Clock::time_point start = Clock::now();
  const Prepared prepared(source, request, job);
  MeasuredModel measured;
  if (request.goal) {
    GoalResult met = meet(device, prepared, request, job);
    result.encode_seconds = seconds_since(start);
    result.model = std::move(met.model);
    measured = met.measured;
    result.goal = GoalOutcome{met.reached, met.decompositions, met.trials, met.decompose_seconds};
  } else {
    result.model = fit(device, prepared, request, request.parameters, job);
    prepared.undo(*result.model);
    if (!request.weights.all_equal()) set_storage(*result.model, request.storage.fitted());
    StorageBound bound;
    if (!request.weights_json.empty()) bound.weights = &request.weights;
    store_model(device, *result.model, source, request.storage, job, bound);
    result.encode_seconds = seconds_since(start);
    measured = measure(device, source, request, *result.model, job);
  }
  add_log_errors(device, source, request, *result.model, job, measured.errors);
  result.errors = measured.errors;
  result.lowest_ssim = measured.lowest_ssim;
  if (!request.train) result.model->info.errors = result.errors;
  return result;
}

}  // namespace weft
