#include "weft/codecs/compress.hpp"

#include <algorithm>
#include <chrono>

#include "weft/codecs/measure.hpp"
#include "weft/codecs/measure_log.hpp"
#include "weft/codecs/store_model.hpp"
#include "weft/codecs/tt.hpp"
#include "weft/codecs/weighted_fit.hpp"
#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

// A model of the source, rounded to the storage.
std::unique_ptr<Model> fit(Device* device, TileSource& source, const CompressRequest& request,
                           Storage storage, Job& job) {
  if (request.train) return round_tt(*request.train, request.parameters, storage, job);
  const Codec& codec = *request.codec;
  return device ? codec.encode(*device, source, request.parameters, storage, job)
                : codec.encode_reference(source, request.parameters, storage, job);
}

// A model of the source with its weights taken out again, as exact as the storage asked for needs
// it.
std::unique_ptr<Model> weighted_fit(Device* device, TileSource& source,
                                    const CompressRequest& request, Job& job) {
  const Storage storage = request.storage.fitted();
  if (request.weights.all_equal()) return fit(device, source, request, storage, job);
  WeightedFit weighted(*request.codec, request.parameters, source, request.weights, job);
  std::unique_ptr<Model> model = fit(device, weighted.source(), request, Storage::f32, job);
  weighted.undo(*model);
  set_storage(*model, storage);
  return model;
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

// Errors of the stored model against the source.
void measure(Device* device, TileSource& source, const CompressRequest& request,
             CompressResult& result, Job& job) {
  SimilarityRequest similarity{request.peak, {}};
  SimilarityRequest* const wanted = request.ssim ? &similarity : nullptr;
  const Model& model = *result.model;
  const Codec& codec = *request.codec;
  WeightedErrors weighted{request.weights, {}};
  WeightedErrors* const weighs = request.weights_json.empty() ? nullptr : &weighted;
  const ErrorSums sums =
      device ? measure_errors(*device, *codec.decoder(*device, model), source, job, wanted, weighs)
             : measure_errors(*codec.reference_decoder(model), source, job, wanted, weighs);
  const double peak = request.peak > 0 ? request.peak : psnr_peak(source.info(), sums);
  result.errors = report(sums, peak);
  if (weighs) result.errors.weighted = weighted_report(weighted.sums, peak);
  if (request.ssim) {
    result.errors.ssim = similarity.sums.mean();
    result.lowest_ssim = similarity.sums.lowest;
  }
}

}  // namespace

void check_parameters(const Codec& codec, const Parameters& parameters) {
  const auto specs = codec.parameters();
  for (const auto& [name, value] : parameters) {
    const bool known = std::any_of(specs.begin(), specs.end(),
                                   [&](const ParameterSpec& spec) { return spec.name == name; });
    if (!known) fail_input("--{} {}: not a parameter of codec {}", name, value, codec.name());
  }
}

CompressResult compress(Device* device, TileSource& source, const CompressRequest& request,
                        Job& job) {
  using Clock = std::chrono::steady_clock;
  check_parameters(*request.codec, request.parameters);
  CompressResult result;
  const Clock::time_point start = Clock::now();
  const ColourTransform transform = colour_transform(source, request, job);
  TransformedSource transformed(source, transform, job.nan_zero);
  TileSource& fitted = transform.is_identity() ? source : transformed;
  result.model = weighted_fit(device, fitted, request, job);
  ModelInfo& info = result.model->info;
  info.selection = request.train ? request.train->info.selection : request.selection;
  info.weights = request.weights_json;
  info.program_version = version();
  info.colour_transform = transform;
  if (!request.train) info.btf.dtype = source.info().dtype;  // a transformed source is F32
  store_model(device, *result.model, source, request.storage, job);
  result.encode_seconds = std::chrono::duration<double>(Clock::now() - start).count();

  measure(device, source, request, result, job);
  if (request.log_error || !transform.is_linear()) {
    LogErrorRequest log;
    log.scale = transform.is_linear() ? mean_magnitude(source, job) : transform.scale;
    measure_log_errors(device, *result.model, source, log, job);
    result.errors.log = report(log.sums, log.scale);
  }
  if (!request.train) info.errors = result.errors;
  return result;
}

}  // namespace weft
