#include "weft/codecs/vq.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string_view>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/codecs/fit_goal.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/codecs/vq_decoder.hpp"
#include "weft/codecs/vq_engine.hpp"
#include "weft/codecs/vq_goal.hpp"
#include "weft/codecs/vq_levels.hpp"
#include "weft/error.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/storage.hpp"
#include "weft/number_list.hpp"
#include "weft/reference/vq.hpp"
#include "weft/reference/vq_light_sampler.hpp"

namespace weft {
namespace {

// From so many views and lights on, onion slices are what is between them.
constexpr std::size_t least_directions = 16;

constexpr std::array<ParameterSpec, 6> vq_parameters{{
    {"threshold", "0.1",
     "how far a texel may be from its code-vector: largest root mean square of differences, as a "
     "part of the data's; with --similarity ssim, the 1 - SSIM that 98 % of its values keep to, "
     "then 0.01 if not given. Or eight, of P4,P3,M,P2,P1,I2,I1,C; what is not given is 0.4 of the "
     "mean square of the level "
     "above, or the same dissimilarity"},
    {"similarity", "mse",
     "mse: squared error; ssim: what a texel in a code-vector's place does to the structural "
     "similarity of the images about it"},
    {"grid", "auto",
     "directions of code-books: onion (slices of the hemisphere of lights, turned with the view), "
     "measured (those of the data), or auto: onion from 16 views and lights on"},
    {"slices", "11,11,7,16", "sizes alpha,beta,theta,phi of onion slices"},
    {"samples", "1,4",
     "percent of the texels that code-books begin with, and that complete them; at least 256 and "
     "768 texels, at most 1024 and 3072"},
    {"levels", "1",
     "mip levels that are kept, the texels themselves the first of them, each with indices of its "
     "own; or all, down to one texel"},
}};

// The threshold of --similarity ssim, where none is given.
constexpr double default_dissimilarity = 0.01;

const VqModel& as_vq(const Model& model) {
  return dynamic_cast<const VqModel&>(model);
}

std::string_view text_of(const Parameters& parameters, std::string_view name) {
  const auto found = parameters.find(name);
  if (found != parameters.end()) return found->second;
  return std::find_if(vq_parameters.begin(), vq_parameters.end(),
                      [&](const ParameterSpec& spec) { return spec.name == name; })
      ->default_value;
}

// Numbers from 0 to `largest` with commas between them, 1 to `most` of them.
std::vector<double> numbers_of(const Parameters& parameters, std::string_view name,
                               std::size_t most, double largest) {
  const std::string_view text = text_of(parameters, name);
  const auto numbers = parse_number_list(text, 0, largest);
  if (!numbers || numbers->size() > most) {
    fail_input("--{} {}: 1 to {} numbers from 0 to {} are needed, with commas between them", name,
               text, most, largest);
  }
  return *numbers;
}

// Of P4, P3, M, P2, P1, I2, I1 and C; those that are not given follow the others.
VqThresholds thresholds_of(const std::vector<double>& given, VqSimilarity similarity) {
  // 0.4 of the mean square (section 4.4.1); dissimilarities need no factor (4.4.2)
  const double below = similarity == VqSimilarity::ssim ? 1 : std::sqrt(0.4);
  VqThresholds t;
  const auto level = [&](std::size_t i, double otherwise) {
    return i < given.size() ? given[i] : otherwise;
  };
  t.p4 = level(0, 0);
  t.p3 = level(1, below * t.p4);
  t.m = level(2, below * t.p3);
  t.p2 = level(3, below * t.m);
  t.p1 = level(4, below * t.p2);
  t.i2 = level(5, t.p2);
  t.i1 = level(6, t.p1);
  t.c = level(7, below * t.i1);
  return t;
}

VqSimilarity similarity_of(const Parameters& parameters) {
  const std::string_view name = text_of(parameters, "similarity");
  if (name != "mse" && name != "ssim") fail_input("--similarity {}: mse or ssim is needed", name);
  return name == "ssim" ? VqSimilarity::ssim : VqSimilarity::mse;
}

VqGrid grid_of(const Parameters& parameters, const BtfInfo& source) {
  const std::string_view name = text_of(parameters, "grid");
  if (name != "auto" && name != "onion" && name != "measured") {
    fail_input("--grid {}: onion, measured or auto is needed", name);
  }
  const OnionSizes sizes = parse_onion_sizes(text_of(parameters, "slices"), "--slices");
  const BtfShape& shape = source.shape;
  const bool enough = source.layout == Layout::grid && shape.views >= least_directions &&
                      shape.lights >= least_directions;
  if (name == "measured" || (name == "auto" && !enough)) {
    if (parameters.contains("slices")) {
      fail_input("--slices {}: of onion slices; these {} views and {} lights are {}",
                 text_of(parameters, "slices"), shape.views, shape.lights,
                 name == "measured" ? "taken as measured"
                                    : "too few: --grid onion takes them nevertheless");
    }
    return VqGrid::measured(shape);
  }
  return {VqGrid::Kind::onion, sizes};
}

std::size_t levels_of(const Parameters& parameters, const BtfShape& shape) {
  const std::string_view text = text_of(parameters, "levels");
  const std::size_t most = last_mip_level(shape.height, shape.width) + 1;
  if (text == "all") return most;
  const std::size_t levels = count_parameter(vq_codec(), parameters, "levels", 1);
  if (levels > most) {
    fail_input("--levels {}: {} x {} texels have {}", levels, shape.width, shape.height, most);
  }
  return levels;
}

}  // namespace

VqRequest vq_request(const Parameters& parameters, const BtfInfo& source) {
  VqRequest request;
  request.similarity = similarity_of(parameters);
  const bool own = !parameters.contains("threshold") && request.similarity == VqSimilarity::ssim;
  request.thresholds = thresholds_of(own ? std::vector<double>{default_dissimilarity}
                                         : numbers_of(parameters, "threshold", 8, 1e6),
                                     request.similarity);
  request.grid = grid_of(parameters, source);
  const std::vector<double> samples = numbers_of(parameters, "samples", 2, 100);
  request.first_part = samples[0] / 100;
  request.second_part = (samples.size() > 1 ? samples[1] : 4 * samples[0]) / 100;
  request.levels = levels_of(parameters, source.shape);
  return request;
}

std::string vq_parameters_json(const VqModel& model, const VqRequest& request,
                               const VqThresholds& t) {
  const OnionSizes& n = model.grid.sizes;
  const VqModel::Sizes& s = model.sizes;
  return fmt::format(
      R"({{"threshold":[{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}],)"
      R"("similarity":"{}","grid":"{}",)"
      R"("slices":[{},{},{},{}],"samples":[{:.6g},{:.6g}],"levels":{},"sizes":{{"P4":{},"P3":{},)"
      R"("M":{},"P2":{},"P1":{},"I2":{},"I1":{},"C":{}}}}})",
      t.p4, t.p3, t.m, t.p2, t.p1, t.i2, t.i1, t.c,
      request.similarity == VqSimilarity::ssim ? "ssim" : "mse",
      model.grid.kind == VqGrid::Kind::onion ? "onion" : "measured", n.alpha, n.beta, n.theta,
      n.phi, 100 * request.first_part, 100 * request.second_part, request.levels, s.p4, s.p3, s.m,
      s.p2, s.p1, s.i2, s.i1, s.c);
}

namespace {

class VqCodec final : public Codec {
 public:
  std::string_view name() const override { return "vq"; }
  std::string_view summary() const override {
    return "multi-level vector quantisation: nested code-books of luminance and chromaticity";
  }
  std::span<const ParameterSpec> parameters() const override { return vq_parameters; }

  bool takes_weights() const override { return false; }
  // Luminance is to be a channel of its own: YCrCb of 8-bit data, LogLuv of others (section 4.3).
  ColourTransform::Kind own_transform(const BtfInfo& source) const override {
    if (source.shape.channels != 3) return ColourTransform::Kind::none;
    return source.dtype == DType::u8 ? ColourTransform::Kind::ycrcb : ColourTransform::Kind::logluv;
  }

  bool takes_goals() const override { return true; }

  std::unique_ptr<Model> encode(Device& device, TileSource& source, const Parameters& parameters,
                                Storage storage, Job& job) const override {
    const VqRequest request = vq_request(parameters, source.info());
    const VqLevels levels(source, request.levels, job.nan_zero);
    const std::size_t trained = vq_trained(levels.sources(), request);
    job.plan(plan_device_vq(device, source.info(), request, trained, job));
    const MakeVqEngine engine = [&](const BtfInfo& info) {
      return device_vq_engine(device, info, request);
    };
    return fit(levels, engine, request, parameters, storage, job, [&](const VqModel& model) {
      return measure_errors(device, *vq_decoder(device, model), source, job);
    });
  }

  std::unique_ptr<Model> encode_reference(TileSource& source, const Parameters& parameters,
                                          Storage storage, Job& job) const override {
    const VqRequest request = vq_request(parameters, source.info());
    const VqLevels levels(source, request.levels, job.nan_zero);
    job.plan(plan_vq(source.info(), request, vq_trained(levels.sources(), request), job));
    const MakeVqEngine engine = [&](const BtfInfo& info) {
      return reference::vq_engine(info, request);
    };
    return fit(levels, engine, request, parameters, storage, job, [&](const VqModel& model) {
      return measure_errors(*vq_reference_decoder(model), source, job);
    });
  }

  std::unique_ptr<Model> fitted_part(const Model& model,
                                     const Selection& selection) const override {
    return as_vq(model).select(selection);
  }

  std::unique_ptr<DeviceDecoder> fitted_decoder(Device& device, const Model& model) const override {
    return vq_decoder(device, as_vq(model));
  }
  std::size_t fitted_decoder_bytes(const Model& model) const override {
    return vq_decoder_bytes(as_vq(model));
  }
  std::unique_ptr<ReferenceDecoder> fitted_reference_decoder(const Model& model) const override {
    return vq_reference_decoder(as_vq(model));
  }

  std::unique_ptr<DeviceSampler> fitted_sampler(Device& device, const Model& model) const override {
    return vq_sampler(device, as_vq(model));
  }
  std::size_t fitted_sampler_bytes(const Model& model) const override {
    return vq_sampler_bytes(as_vq(model));
  }

  // On the host either way: a search in a few rows of the code-books, with no look-up behind it.
  std::unique_ptr<LightSampler> fitted_light_sampler(Device* /*device*/,
                                                     const Model& model) const override {
    return reference::vq_light_sampler(as_vq(model));
  }

  double fitted_tolerance(const Model& model) const override {
    return vq_decode_tolerance(as_vq(model));
  }

  std::unique_ptr<Model> read(const ModelFile& file) const override { return VqModel::read(file); }

  std::unique_ptr<Model> fitted_mip_level(const Model& model) const override {
    return as_vq(model).next_mip_level();
  }
  bool has_fitted_mip_level(const Model& model) const override {
    return !as_vq(model).coarser.empty();
  }

 private:
  using Measure = std::function<ErrorSums(const VqModel& model)>;

  std::unique_ptr<Model> fit(const VqLevels& levels, const MakeVqEngine& engine,
                             const VqRequest& request, const Parameters& parameters,
                             Storage storage, Job& job, const Measure& measure) const {
    VqJointFit joint(levels.sources(), engine, request, job);
    const BtfInfo& source = levels.sources().front()->info();
    const FitGoal goal = fit_goal(parameters, source);
    std::size_t trained = 0;
    const auto fit_with = [&](const VqThresholds& thresholds) {
      VqFit result = joint.fit(thresholds);
      trained = result.trained;
      VqModel& model = *result.model;
      levels.take(result.indices, 0, model);
      model.info.codec = name();
      model.info.storage = storage;
      model.info.btf = source;
      model.info.parameters = vq_parameters_json(model, request, thresholds);
      round_to_storage(model);
      return std::move(result.model);
    };
    std::unique_ptr<VqModel> model;
    if (!goal) {
      model = fit_with(request.thresholds);
    } else {
      // thresholds that are given are the least
      const bool given = parameters.contains("threshold") && request.thresholds.p4 > 0;
      const VqThresholds unit = given ? request.thresholds.times(1 / request.thresholds.p4)
                                      : thresholds_of({1.0}, request.similarity);
      VqGoalSteps steps;
      steps.fit = [&](double factor) { return fit_with(unit.times(factor)); };
      steps.relative_error = [&](const VqModel& fitted) {
        const ErrorSums sums = measure(fitted);
        return std::sqrt(sums.square_difference / sums.square_reference);
      };
      model = meet_vq_goal(goal, given ? request.thresholds.p4 : 0, steps, job);
    }
    const OnionSizes& n = model->grid.sizes;
    const VqModel::Sizes& s = model->sizes;
    job.notes.push_back(fmt::format(
        "{} x {} x {} x {} nodes of {}; code-books of {} texels: P4 {}, P3 {}, M {}, P2 {}, P1 {}, "
        "I2 {}, I1 {}, C {}",
        n.phi, n.theta, n.alpha, n.beta,
        model->grid.kind == VqGrid::Kind::onion ? "onion slices" : "measured directions", trained,
        s.p4, s.p3, s.m, s.p2, s.p1, s.i2, s.i1, s.c));
    if (request.levels > 1) {
      VqModel finest(*model);
      finest.coarser.clear();
      const std::size_t bytes = model_file_size(*finest.select({}));
      job.notes.push_back(fmt::format(
          "{} mip levels: {:.4g} times the {} bytes of the texels alone", request.levels,
          static_cast<double>(model_file_size(*model)) / static_cast<double>(bytes), bytes));
    }
    return model;
  }
};

}  // namespace

const Codec& vq_codec() {
  static const VqCodec codec;
  return codec;
}

}  // namespace weft
