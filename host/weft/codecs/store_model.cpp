#include "weft/codecs/store_model.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
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
constexpr int most_codings = 8;          // of the whole model, to find a size

// Components whose gain is measured together.
using Group = std::vector<std::size_t>;

struct RealTensor {
  std::string name;
  ComponentLayout layout;
  std::vector<float> peaks;
  std::vector<double> squares;  // of each component's values, their mean
  std::vector<double> gains;    // of each component
};

// The mean square of each component's values.
std::vector<double> mean_squares(std::span<const float> values, const ComponentLayout& layout) {
  std::vector<double> squares(layout.components, 0.0);
  const double count = static_cast<double>(layout.outer * layout.inner);
  for (std::size_t i = 0; i < values.size(); ++i) {
    squares[i / layout.inner % layout.components] += double{values[i]} * double{values[i]} / count;
  }
  return squares;
}

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
        sizer_(bound.sizer ? *bound.sizer : own_sizer_),
        images_(sample_images(model.info.btf.shape)) {
    plan();
    for (const std::span<float> values : model.real_values()) {
      fitted_.emplace_back(values.begin(), values.end());
    }
    for (const ModelTensor& tensor : model.tensors()) {
      if (tensor.dtype != DType::f32) continue;
      const ComponentLayout layout = component_layout(tensor.shape, tensor.component_axis);
      const std::vector<float>& values = fitted_[tensors_.size()];
      tensors_.push_back(
          {tensor.name, layout, component_peaks(values, layout), mean_squares(values, layout), {}});
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
      half_size = sizer_.size(model_);
      restore();
    }
    measure_gains();
    const bool met = search(*most_squares, fitted);
    if (met && sizer_.size(model_) <= half_size) {
      note(fmt::format("at most {:.4g} of the unquantised model's squared error",
                       fitted > 0 ? *most_squares / fitted : 0.0));
      return;
    }
    restore();
    if (!has_goal) round_to_half();
    job_.notes.push_back(fmt::format("storage auto: {}, quantised tensors do not make it smaller",
                                     storage_text(model_.info)));
  }

  // Steps as fine as the bound's bytes allow; float, where that is as small. False, with the
  // coarsest, where these take more.
  bool choose_within_bytes() {
    restore();
    if (sizer_.size_with_errors(model_) <= bound_.most_bytes) return true;
    measure_gains();
    const StageTimer timer(job_, "steps of quantisation");
    const double most = static_cast<double>(bound_.most_bytes);
    const double least = size_with(std::numeric_limits<double>::infinity());  // nothing but zeros
    if (least > most) return false;
    constexpr double wanted = 0.9965;  // of the bytes that are allowed
    constexpr double near = 0.993;
    double within = std::numeric_limits<double>::infinity();
    double beyond = 0;
    double own_slope = 0.125;
    double& slope = bound_.bytes_of_bit ? *bound_.bytes_of_bit : own_slope;
    double bits = (wanted * most - least) / slope;
    double bits_before = 0;
    double size_before = least;
    for (int i = 0; i < most_codings || !std::isfinite(within); ++i) {
      double lambda = lambda_of(bits);
      if (!(lambda < within && lambda > beyond)) {
        lambda = !std::isfinite(within) ? 2 * beyond
                 : beyond > 0           ? std::sqrt(within * beyond)
                                        : within / 2;
      }
      if (!std::isfinite(lambda) || lambda == within || lambda == beyond) break;
      const double size = size_with(lambda);
      bits = bits_with(lambda);
      if (i == 0) slope = std::max((size - least) / bits, 1e-6);
      if (size <= most) within = lambda;
      if (size > most) beyond = lambda;
      if (size <= most && size >= near * most) break;
      // Bytes grow ever faster with the bits: by how much the last two tell, and the first alone
      // somewhere between what it took and whole bits.
      double growth = (size - size_before) / (bits - bits_before);
      if (i == 0) growth = std::sqrt(slope * std::max(slope, 0.125));
      bits_before = bits;
      size_before = size;
      bits += (wanted * most - size) / (growth > 0 ? growth : slope);
    }
    quantise_with(within);
    note(fmt::format("a file of {} bytes at most", bound_.most_bytes));
    return true;
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

  // |change of the sample|^2 / |change of the values|^2 for a group that is `rounded` alone; 0
  // where nothing changes.
  double gain(std::size_t n, const Group& group, std::span<const float> rounded,
              std::span<const float> sample) {
    const ComponentLayout& layout = tensors_[n].layout;
    const std::span<float> values = model_.real_values()[n];
    double change = 0;
    const auto replace = [&](std::span<const float> by) {
      for (const std::size_t c : group) {
        for (std::size_t o = 0; o < layout.outer; ++o) {
          const std::size_t first = (o * layout.components + c) * layout.inner;
          const std::span<float> run = values.subspan(first, layout.inner);
          change += sum_squares_between(run, by.subspan(first, layout.inner));
          std::copy_n(by.begin() + static_cast<std::ptrdiff_t>(first), layout.inner, run.begin());
        }
      }
    };
    replace(rounded);
    if (change == 0) return 0;
    const double share = static_cast<double>(model_.info.btf.shape.images()) / sample_weight();
    const double result = sample_squares_between(decoded(), sample) * share / change;
    replace(fitted_[n]);
    return result;
  }

  void measure_gains() {
    const StageTimer timer(job_, "gains of quantisation");
    const std::vector<float> sample = decoded();
    for (std::size_t n = 0; n < tensors_.size(); ++n) {
      RealTensor& tensor = tensors_[n];
      tensor.gains.assign(tensor.layout.components, 0.0);
      std::vector<float> rounded = fitted_[n];
      quantise(rounded, tensor.layout, {probing_bits, steps_of_bits(tensor.peaks, probing_bits)});
      for (const Group& group : groups_of(n)) {
        const double found = gain(n, group, rounded, sample);
        for (const std::size_t c : group) tensor.gains[c] = found;
      }
      // What changes nothing in the sample may matter elsewhere.
      double least = std::numeric_limits<double>::infinity();
      for (const double g : tensor.gains) least = g > 0 ? std::min(least, g) : least;
      if (!std::isfinite(least)) least = 1;
      std::replace(tensor.gains.begin(), tensor.gains.end(), 0.0, least);
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

  // Of the file, where components have g step^2 = lambda^2.
  double size_with(double lambda) {
    quantise_with(lambda);
    return static_cast<double>(sizer_.size_with_errors(model_));
  }

  // Bits of all codes, about: a value of mean square s takes log2(s g / lambda^2) / 2 and those of
  // a normal distribution's entropy, log2(2 pi e) / 2, until it is mostly zero.
  double bits_with(double lambda) const {
    constexpr double normal = 2 * std::numbers::pi * std::numbers::e;
    double bits = 0;
    for (const RealTensor& tensor : tensors_) {
      const auto count = static_cast<double>(tensor.layout.outer * tensor.layout.inner);
      for (std::size_t c = 0; c < tensor.squares.size(); ++c) {
        const double value = std::sqrt(tensor.squares[c] * tensor.gains[c]) / lambda;
        bits += count * std::log2(1 + normal * value * value) / 2;
      }
    }
    return bits;
  }

  // The inverse.
  double lambda_of(double bits) const {
    double fine = -400;  // base 2 logarithms
    double coarse = 400;
    constexpr int halvings = 50;
    for (int i = 0; i < halvings; ++i) {
      const double middle = (fine + coarse) / 2;
      (bits_with(std::exp2(middle)) > bits ? fine : coarse) = middle;
    }
    return std::exp2(coarse);
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

  void note(const std::string& kept_within) {
    std::string bits;
    for (const RealTensor& tensor : tensors_) {
      bits += fmt::format("{}{} {}", bits.empty() ? "" : ", ", tensor.name,
                          model_.info.quantised.at(tensor.name).bits);
    }
    job_.notes.push_back(fmt::format("storage auto: {}, bits {}", kept_within, bits));
  }

  Device* device_;
  Model& model_;
  TileSource& source_;
  const StorageBound& bound_;
  Job& job_;
  FileSizer own_sizer_;
  FileSizer& sizer_;
  std::vector<std::size_t> images_;
  std::vector<std::vector<float>> fitted_;
  std::vector<RealTensor> tensors_;
};

}  // namespace

bool store_model(Device* device, Model& model, TileSource& source, const StorageRequest& request,
                 Job& job, const StorageBound& bound) {
  using Kind = StorageRequest::Kind;
  if (request.kind == Kind::bits) {
    job.plan(plan_of(model, 1));
    quantise_all(model, request.bits);
  } else if (request.kind == Kind::automatic) {
    Allocation allocation(device, model, source, bound, job);
    if (bound.most_bytes > 0) return allocation.choose_within_bytes();
    allocation.choose(request.slack);
  } else {
    round_to_storage(model);
  }
  return true;
}

std::size_t storing_bytes(const StorageRequest& request, std::size_t numbers) {
  using Kind = StorageRequest::Kind;
  const bool quantises = request.kind == Kind::bits || request.kind == Kind::automatic;
  const std::size_t copies = request.kind == Kind::automatic ? 1 : 0;  // see plan_of
  return (copies + (quantises ? 3 : 0)) * numbers * sizeof(float);
}

}  // namespace weft
