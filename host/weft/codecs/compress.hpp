// Compression: from a source to a model with the errors that were measured of it.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "weft/btf/weights.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/codecs/colour_source.hpp"
#include "weft/codecs/goal.hpp"
#include "weft/codecs/meet_goal.hpp"
#include "weft/metrics/error_sums.hpp"
#include "weft/model/storage.hpp"
#include "weft/model/tt.hpp"

namespace weft {

struct CompressRequest {
  const Codec* codec = nullptr;
  Parameters parameters;
  StorageRequest storage;
  std::string selection = "{}";  // what of the raw BTF the source is, as the model records it
  ColourRequest colour;          // what is fitted instead of the stored values
  Weights weights;               // of the source, each mode's of mean 1
  std::string weights_json;      // what they are, as the model records it; empty: none were given
  double peak = 0;               // of the PSNR; 0: by the data's type
  bool ssim = false;
  bool log_error = false;  // on a logarithmic scale too; always where a logarithm is fitted
  Goal goal;               // what is to be reached, if anything
  bool may_widen = false;  // whether f32 may take the place of f16 where that misses the goal
  // The model of the source's mask, which the model then holds instead of the mask.
  std::shared_ptr<const Occlusion> occlusion;
  // A tensor train that is cut further instead of fitting one: the source is what it decodes to.
  std::shared_ptr<const TtModel> train;
};

// How a goal was met.
struct GoalOutcome {
  double reached = 0;              // in the goal's kind
  std::size_t decompositions = 0;  // that were made
  std::size_t trials = 0;          // models that were measured
  double encode_seconds = 0;       // of one decomposition, the last
};

struct CompressResult {
  std::unique_ptr<Model> model;  // as it is stored
  ErrorReport errors;            // against the source
  // of the images, where the similarity was asked for
  double lowest_ssim = std::numeric_limits<double>::quiet_NaN();
  double encode_seconds = 0;  // with a goal, of all the search
  std::optional<GoalOutcome> goal;
};

// Compresses all of `source` on the device, or by the reference if it is null. Where there are
// weights, the fit minimises the weighted error, which is measured beside the plain one. Errors are
// measured:
// the model, as stored, is decoded and compared with the source; the model holds them too, unless
// it was cut of a train, whose errors are no raw BTF's. Throws input errors for parameters that the
// codec does not have or that make no sense, what the codec's encoder throws, and an unmet goal.
CompressResult compress(Device* device, TileSource& source, const CompressRequest& request,
                        Job& job);

// Errors of a model, as it is stored, against the source, in what the request asks for.
MeasuredModel measure_model(Device* device, TileSource& source, const CompressRequest& request,
                            const Model& model, Job& job);

// Throws the input error for parameters that are not the codec's.
void check_parameters(const Codec& codec, const Parameters& parameters);

}  // namespace weft
