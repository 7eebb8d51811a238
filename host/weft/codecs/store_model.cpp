#include "weft/codecs/store_model.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "weft/codecs/decoded_source.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/model/component_scale.hpp"
#include "weft/model/quantise.hpp"

namespace weft {
namespace {

constexpr std::size_t most_groups = 16;  // of components, in one tensor
constexpr unsigned probing_bits = 6;     // coarse against the decoder's rounding
constexpr int most_measurements = 8;     // of the whole model

// Components whose gain is measured together.
using Group = std::vector<std::size_t>;

struct RealTensor {
  std::string name;
  ComponentLayout layout;
  std::vector<float> peaks;
  std::vector<double> gains;  // of each component
};

// Images such that every view and every light is in one at least.
std::vector<std::size_t> sample_images(const BtfShape& shape) {
  const std::size_t count = std::max(shape.views, shape.lights);
  // lights in a stride that is coprime to their number, so that neighbours do not go together
  std::size_t stride = std::max<std::size_t>(shape.lights * 5 / 8, 1);
  while (std::gcd(stride, shape.lights) != 1) ++stride;
  std::vector<std::size_t> images;
  images.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    images.push_back(i % shape.views * shape.lights + i * stride % shape.lights);
  }
  return images;
}

double sum_squares_between(std::span<const float> a, std::span<const float> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double difference = double{a[i]} - double{b[i]};
    sum += difference * difference;
  }
  return sum;
}

// Of the model in host memory, with what coding its largest tensor takes.
MemoryPlan plan_of(Model& model, std::size_t copies) {
  std::size_t numbers = 0;
  std::size_t largest = 0;
  for (const std::span<float> values : model.real_values()) {
    numbers += values.size();
    largest = std::max(largest, values.size());
  }
  MemoryPlan plan;
  plan.add("fitted model", copies * numbers * sizeof(float));
  plan.add("codes of a tensor", 3 * largest * sizeof(float));
  return plan;
}

class Allocation {
 public:
  Allocation(Device* device, Model& model, TileSource& source, const StorageBound& bound, Job& job)
      : device_(device),
        model_(model),
        source_(source),
        bound_(bound),
        job_(job),
        images_(sample_images(model.info.btf.shape)) {
    plan();
    for (const std::span<float> values : model.real_values()) {
      fitted_.emplace_back(values.begin(), values.end());
    }
    for (const ModelTensor& tensor : model.tensors()) {
      if (tensor.dtype != DType::f32) continue;
      const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
      tensors_.push_back(
          {tensor.name, layout, component_peaks(fitted_[tensors_.size()], layout), {}});
    }
  }

  void choose(double slack) {
    std::optional<double> most_squares = bound_.most_squares;
    const bool has_goal = most_squares.has_value();
    set_storage(model_, Storage::f32);
    const double fitted = squares();
    std::size_t half_size = std::numeric_limits<std::size_t>::max();
    if (!has_goal) {
      round_to_half();
      const double half = std::max(squares(), fitted);
      most_squares = (1 + slack) * (1 + slack) * half;
      half_size = model_file_size(model_);
      restore();
    }
    measure_gains();
    const bool met = search(*most_squares, fitted);
    if (met && model_file_size(model_) <= half_size) {
      note(fitted, *most_squares);
      return;
    }
    restore();
    if (!has_goal) round_to_half();
    job_.notes.push_back(fmt::format("storage auto: {}, quantised tensors do not make it smaller",
                                     storage_text(model_.info)));
  }

 private:
  void plan() const {
    MemoryPlan plan = plan_of(model_, 2);
    plan.add("model on the device", find_codec(model_.info.codec).decoder_bytes(model_));
    plan.add("decoded images",
             2 * images_.size() * model_.info.btf.shape.image_values() * sizeof(float));
    job_.plan(plan);
  }

  double squares() {
    const Codec& codec = find_codec(model_.info.codec);
    const Weights equal;
    WeightedErrors weighted{bound_.weights ? *bound_.weights : equal, {}};
    WeightedErrors* const weighs = bound_.weights ? &weighted : nullptr;
    const ErrorSums sums =
        device_ ? measure_errors(*device_, *codec.decoder(*device_, model_), source_, job_, nullptr,
                                 weighs)
                : measure_errors(*codec.reference_decoder(model_), source_, job_, nullptr, weighs);
    return weighs ? weighted.sums.square_difference : sums.square_difference;
  }

  // |a - b|^2 of two decodings of the sample, as the error is weighted.
  double sample_squares_between(std::span<const float> a, std::span<const float> b) const {
    if (!bound_.weights) return sum_squares_between(a, b);
    const BtfShape& shape = model_.info.btf.shape;
    double sum = 0;
    for (std::size_t i = 0; i < images_.size(); ++i) {
      double image = 0;
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        const std::size_t first = (i * shape.texels() + p) * shape.channels;
        image += bound_.weights->texel(p) * sum_squares_between(a.subspan(first, shape.channels),
                                                                b.subspan(first, shape.channels));
      }
      sum += bound_.weights->image(images_[i], shape.lights) * image;
    }
    return sum;
  }

  // Weight of the sample's images.
  double sample_weight() const {
    if (!bound_.weights) return static_cast<double>(images_.size());
    double sum = 0;
    for (const std::size_t i : images_) {
      sum += bound_.weights->image(i, model_.info.btf.shape.lights);
    }
    return sum;
  }

  void restore() {
    set_storage(model_, Storage::f32);
    const std::vector<std::span<float>> values = model_.real_values();
    for (std::size_t n = 0; n < values.size(); ++n) {
      std::copy(fitted_[n].begin(), fitted_[n].end(), values[n].begin());
    }
  }

  void round_to_half() {
    restore();
    set_storage(model_, Storage::f16);
    round_to_storage(model_);
  }

  // The sample, decoded as the model is now.
  std::vector<float> decoded() {
    // the source lives no longer than the model
    const auto whole =
        decoded_source(device_, std::shared_ptr<const Model>(std::shared_ptr<void>(), &model_));
    const std::size_t image = model_.info.btf.shape.image_values();
    std::vector<float> values(images_.size() * image);
    for (std::size_t i = 0; i < images_.size(); ++i) {
      whole->read(images_[i], 1,
                  std::as_writable_bytes(std::span(values).subspan(i * image, image)));
    }
    return values;
  }

  // Components in groups of what is likely to have about the same gain: the norms of what other
  // tensors multiply them with, where these have as many components, decide, else their order.
  std::vector<Group> groups_of(std::size_t n) const {
    const std::size_t count = tensors_[n].layout.components;
    std::vector<double> weight(count, 1.0);
    for (std::size_t m = 0; m < tensors_.size(); ++m) {
      if (m == n || tensors_[m].layout.components != count) continue;
      for (std::size_t c = 0; c < count; ++c) weight[c] *= double{tensors_[m].peaks[c]};
    }
    Group order(count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return weight[a] > weight[b]; });
    const std::size_t groups = std::min(count, most_groups);
    std::vector<Group> result;
    for (std::size_t g = 0; g < groups; ++g) {
      const auto begin = order.begin() + static_cast<std::ptrdiff_t>(g * count / groups);
      const auto end = order.begin() + static_cast<std::ptrdiff_t>((g + 1) * count / groups);
      result.emplace_back(begin, end);
    }
    return result;
  }

  // |change of the sample|^2 / |change of the values|^2 for a group that is quantised alone; 0
  // where nothing changes.
  double gain(std::size_t n, const Group& group, std::span<const float> sample) {
    const RealTensor& tensor = tensors_[n];
    const std::span<float> values = model_.real_values()[n];
    const Quantisation probe{probing_bits, steps_of_bits(tensor.peaks, probing_bits)};
    std::vector<float> rounded(values.begin(), values.end());
    quantise(rounded, tensor.layout, probe);
    for (const std::size_t c : group) {
      for (std::size_t o = 0; o < tensor.layout.outer; ++o) {
        const auto first = (o * tensor.layout.components + c) * tensor.layout.inner;
        std::copy_n(rounded.begin() + static_cast<std::ptrdiff_t>(first), tensor.layout.inner,
                    values.begin() + static_cast<std::ptrdiff_t>(first));
      }
    }
    const double change = sum_squares_between(values, fitted_[n]);
    double result = 0;
    if (change > 0) {
      const double share = static_cast<double>(model_.info.btf.shape.images()) / sample_weight();
      result = sample_squares_between(decoded(), sample) * share / change;
    }
    std::copy(fitted_[n].begin(), fitted_[n].end(), values.begin());
    return result;
  }

  void measure_gains() {
    const StageTimer timer(job_, "gains of quantisation");
    const std::vector<float> sample = decoded();
    for (std::size_t n = 0; n < tensors_.size(); ++n) {
      std::vector<double>& gains = tensors_[n].gains;
      gains.assign(tensors_[n].layout.components, 0.0);
      for (const Group& group : groups_of(n)) {
        const double found = gain(n, group, sample);
        for (const std::size_t c : group) gains[c] = found;
      }
      // What changes nothing in the sample may matter elsewhere.
      double least = std::numeric_limits<double>::infinity();
      for (const double g : gains) least = g > 0 ? std::min(least, g) : least;
      if (!std::isfinite(least)) least = 1;
      std::replace(gains.begin(), gains.end(), 0.0, least);
    }
  }

  void quantise_with(double lambda) {
    restore();
    for (std::size_t n = 0; n < tensors_.size(); ++n) {
      const RealTensor& tensor = tensors_[n];
      std::vector<float> steps(tensor.peaks.size(), 0.0f);
      for (std::size_t c = 0; c < steps.size(); ++c) {
        // a step past twice the peak only leaves zeros
        const double step = std::min(lambda / std::sqrt(tensor.gains[c]), 4.0 * tensor.peaks[c]);
        steps[c] = step_at_least(std::min(step, 0x1p126));
      }
      quantise_tensor(model_, n, steps);
    }
  }

  // The largest lambda found with an error within the bound; false if there is none. The added
  // error grows about as lambda^2.
  bool search(double most_squares, double fitted) {
    const double allowed = most_squares - fitted;
    if (!(allowed > 0)) return false;
    double numbers = 0;
    for (const std::vector<float>& values : fitted_) numbers += static_cast<double>(values.size());
    double lambda = std::sqrt(12 * allowed / std::max(numbers, 1.0));
    double within = 0;
    double beyond = std::numeric_limits<double>::infinity();
    for (int i = 0; i < most_measurements; ++i) {
      quantise_with(lambda);
      const double added = squares() - fitted;
      const bool fits = added <= allowed;
      (fits ? within : beyond) = lambda;
      const double used = added / allowed;
      if (fits && used > 0.97) break;
      // towards 0.985 of the bound, and never out of what is known
      const double growth = used > 0 ? std::sqrt(0.985 / used) : 4.0;
      double next = lambda * std::clamp(growth, 0.25, 4.0);
      if (!(next > within && next < beyond)) next = std::sqrt(within * beyond);
      if (!std::isfinite(next) || next == 0) break;
      lambda = next;
    }
    if (within == 0) return false;
    quantise_with(within);
    return true;
  }

  void note(double fitted, double most_squares) {
    std::string bits;
    for (const RealTensor& tensor : tensors_) {
      bits += fmt::format("{}{} {}", bits.empty() ? "" : ", ", tensor.name,
                          model_.info.quantised.at(tensor.name).bits);
    }
    job_.notes.push_back(fmt::format(
        "storage auto: at most {:.4g} of the unquantised model's squared error, bits {}",
        fitted > 0 ? most_squares / fitted : 0.0, bits));
  }

  Device* device_;
  Model& model_;
  TileSource& source_;
  const StorageBound& bound_;
  Job& job_;
  std::vector<std::size_t> images_;
  std::vector<std::vector<float>> fitted_;
  std::vector<RealTensor> tensors_;
};

}  // namespace

void store_model(Device* device, Model& model, TileSource& source, const StorageRequest& request,
                 Job& job, const StorageBound& bound) {
  using Kind = StorageRequest::Kind;
  if (request.kind == Kind::bits) {
    job.plan(plan_of(model, 1));
    quantise_all(model, request.bits);
  } else if (request.kind == Kind::automatic) {
    Allocation(device, model, source, bound, job).choose(request.slack);
  } else {
    round_to_storage(model);
  }
}

}  // namespace weft
