#include "weft/codecs/choose_codec.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "weft/btf/selection.hpp"
#include "weft/codecs/measure.hpp"
#include "weft/error.hpp"
#include "weft/model/kcta.hpp"
#include "weft/model/sparse.hpp"
#include "weft/model/tt.hpp"
#include "weft/model/tucker.hpp"
#include "weft/reference/random.hpp"
#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::vector<std::size_t> every(std::size_t size, std::size_t step) {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < size; i += step) kept.push_back(i);
  return kept;
}

constexpr std::size_t most_side = 64;

// The part that is tried, with a side of so many texels at most; see choose_codec.hpp.
Selection part_of(const BtfInfo& info, std::size_t side) {
  constexpr std::size_t most_values = std::size_t{1} << 21;
  const BtfShape& shape = info.shape;
  const std::size_t width = std::min(shape.width, side);
  const std::size_t height = std::min(shape.height, side);
  Selection part;
  part.region = Region{(shape.width - width) / 2, (shape.height - height) / 2, width, height};
  const bool grid = info.layout == Layout::grid;
  for (std::size_t step = 1;; ++step) {
    part.views = every(shape.views, step);
    if (grid) part.lights = every(shape.lights, step);
    const std::size_t lights = grid ? part.lights->size() : shape.lights;
    const std::size_t images = part.views->size() * lights;
    if (images * width * height * shape.channels <= most_values || images == 1) return part;
  }
}

// By how much a mode is longer in the whole.
double growth_of(Mode mode, const BtfShape& part, const BtfShape& whole) {
  return static_cast<double>(mode_size(whole, mode)) / static_cast<double>(mode_size(part, mode));
}

// The modes of tensors of the codecs without a core, by name; others grow with none.
struct TensorModes {
  std::string_view name;
  std::string_view modes;  // of v, l and p, the texels
};
constexpr std::array<TensorModes, 11> tensor_modes{{{"mean", "vl"},
                                                    {"coefficients", "p"},
                                                    {"basis", "vl"},
                                                    {"images", "vp"},
                                                    {"clusters", "p"},
                                                    {"ranks", ""},
                                                    {"dictionary", "l"},
                                                    {"view_atoms", "v"},
                                                    {"view_coefficients", "v"},
                                                    {"texel_atoms", "p"},
                                                    {"texel_coefficients", "p"}}};

double growth_of(std::string_view tensor, const BtfShape& part, const BtfShape& whole) {
  double growth = 1;
  for (const TensorModes& known : tensor_modes) {
    if (known.name != tensor) continue;
    for (const char mode : known.modes) {
      if (mode == 'v') growth *= growth_of(Mode::view, part, whole);
      if (mode == 'l') growth *= growth_of(Mode::light, part, whole);
      if (mode == 'p') {
        growth *= growth_of(Mode::row, part, whole) * growth_of(Mode::column, part, whole);
      }
    }
  }
  return growth;
}

// Numbers of a model, in units of its own, and of one of the whole.
struct Numbers {
  double part = 0;
  double whole = 0;
  void add(double count, double growth) {
    part += count;
    whole += count * growth;
  }
};

Numbers numbers_of(const Model& model, const BtfShape& whole) {
  const BtfShape& part = model.info.btf.shape;
  Numbers numbers;
  if (const auto* train = dynamic_cast<const TtModel*>(&model)) {
    for (std::size_t n = 0; n < mode_count; ++n) {
      numbers.add(static_cast<double>(train->cores[n].size()),
                  growth_of(train->order[n], part, whole));
    }
    return numbers;
  }
  if (const auto* tucker = dynamic_cast<const TuckerModel*>(&model)) {
    double core = 1;
    for (std::size_t n = 0; n < tucker->groups.count(); ++n) {
      double growth = 1;
      for (const Mode mode : tucker->groups.groups()[n].modes) {
        growth *= growth_of(mode, part, whole);
      }
      numbers.add(static_cast<double>(tucker->factors[n].size()), growth);
      if (!tucker->has_factor(n)) core *= growth;
    }
    numbers.add(static_cast<double>(tucker->core.size()), core);
    return numbers;
  }
  if (const auto* clustered = dynamic_cast<const KctaModel*>(&model)) {
    double core = 1;
    for (std::size_t n = 0; n < clustered->groups.count(); ++n) {
      double growth = 1;
      for (const Mode mode : clustered->groups.groups()[n].modes) {
        growth *= growth_of(mode, part, whole);
      }
      if (n == clustered->mode) {
        numbers.add(static_cast<double>(clustered->mixing.size()) +
                        static_cast<double>(clustered->members.size()) / 2,
                    growth);
      } else if (clustered->has_factor(n)) {
        numbers.add(static_cast<double>(clustered->global[n].size() + clustered->local[n].size()),
                    growth);
      } else {
        core *= growth;
      }
    }
    numbers.add(static_cast<double>(clustered->cores.size()), core);
    return numbers;
  }
  for (const ModelTensor& tensor : model.tensors()) {
    // an index takes about half of a number
    const double size = tensor.dtype == DType::f32 ? 1.0 : 0.5;
    numbers.add(size * static_cast<double>(product(std::span(tensor.shape))),
                growth_of(tensor.name, part, whole));
  }
  return numbers;
}

// Random single texels.
std::vector<std::uint32_t> random_lookups(const BtfShape& shape, std::size_t count) {
  std::vector<std::uint32_t> records;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t limits[]{shape.texels(), shape.views, shape.lights};
    for (std::size_t j = 0; j < 3; ++j) {
      records.push_back(static_cast<std::uint32_t>(reference::splitmix64(i, j) % limits[j]));
    }
  }
  return records;
}

// Look-ups per second, the best of some rounds after one that builds kernels.
double lookup_rate(Device* device, const Codec& codec, const Model& model) {
  constexpr std::size_t rounds = 3;
  const std::size_t count = device ? std::size_t{1} << 16 : std::size_t{1} << 10;
  const BtfShape& shape = model.info.btf.shape;
  const std::vector<std::uint32_t> records = random_lookups(shape, count);
  double least = std::numeric_limits<double>::infinity();
  const auto best_of = [&](const auto& look_up) {
    look_up();
    for (std::size_t round = 0; round < rounds; ++round) {
      const Clock::time_point start = Clock::now();
      look_up();
      least = std::min(least, seconds_since(start));
    }
  };
  if (device) {
    const auto sampler = codec.sampler(*device, model);
    Buffer in(*device, records.size() * sizeof(std::uint32_t), "look-ups");
    Buffer out(*device, count * shape.channels * sizeof(float), "looked up");
    device->write(in, std::span<const std::uint32_t>(records));
    best_of([&] {
      sampler->look_up({1, 1, 1}, count, in, out);
      device->finish();
    });
  } else {
    const auto sampler = codec.reference_sampler(model);
    std::vector<double> out(count * shape.channels);
    best_of([&] { sampler->look_up({1, 1, 1}, records, out); });
  }
  return static_cast<double>(count) / least;
}

class Trials {
 public:
  Trials(Device* device, TileSource& source, const CompressRequest& request, Job& job)
      : device_(device), shape_(source.info().shape), request_(request) {
    const Selection part = part_of(source.info(), most_side);
    part_ = select(std::shared_ptr<TileSource>(&source, [](TileSource*) {}), part);
    share_ =
        static_cast<double>(part_->info().shape.values()) / static_cast<double>(shape_.values());
    if (share_ < 1 && !request.goal.by_size()) {
      Selection more = part_of(source.info(), most_side / 2);
      more_ = sample(source, request, more);
      more.views = part.views;
      more.lights = part.lights;
      fewer_ = sample(source, request, more);
    }
    quiet_.memory = job.memory;
    quiet_.seed = job.seed;
    quiet_.nan_zero = job.nan_zero;
    request_.ssim = false;
    request_.selection = "{}";
    request_.occlusion = nullptr;  // that of the whole is none of a part
    request_.weights = select(request.weights, source.info(), part);
    // the peak is that of all the data
    const bool of_peak = request.goal.kind == GoalKind::psnr || request.goal.kind == GoalKind::ssim;
    if (of_peak && request.peak == 0 && source.info().dtype != DType::u8) {
      request_.peak = psnr_peak(source.info(), sums_of(device, source, job));
    }
  }

  const BtfShape& part_shape() const { return part_->info().shape; }

  CodecTrial trial(const Codec& codec) {
    CodecTrial trial;
    trial.codec = &codec;
    trial.reached = std::numeric_limits<double>::quiet_NaN();
    trial.snr = trial.reached;
    try {
      request_.codec = &codec;
      const CompressResult result = request_.goal.by_size() ? by_size() : by_error();
      trial.met = true;
      trial.reached = result.goal->reached;
      trial.snr = result.errors.snr;
      trial.bytes = grown_bytes(*result.model, shape_);
      // the atoms of sparse lists are as many as are given
      if (!dynamic_cast<const SparseModel*>(result.model.get())) trial.bytes *= rank_growth();
      trial.encode_seconds = result.encode_seconds / share_;
      trial.lookups = lookup_rate(device_, codec, *result.model);
    } catch (const Error& error) {
      // what is wrong with the request or the data is wrong for every codec, but for weights
      const bool of_weights = error.kind() == ErrorKind::input && !request_.weights_json.empty();
      if (error.kind() != ErrorKind::unmet_goal && !of_weights) throw;
      trial.outcome = error.what();
    }
    return trial;
  }

 private:
  CompressResult by_error() { return compress(device_, *part_, request_, quiet_); }

  // A part of the source with its weights.
  struct Sample {
    std::shared_ptr<TileSource> source;
    Weights weights;
  };
  static Sample sample(TileSource& source, const CompressRequest& request,
                       const Selection& selection) {
    return {select(std::shared_ptr<TileSource>(&source, [](TileSource*) {}), selection),
            select(request.weights, source.info(), selection)};
  }

  // By how much a model of the whole is larger than the part's ranks tell.
  double rank_growth() {
    const auto images = [](const Sample& sample) {
      return static_cast<double>(sample.source->info().shape.images());
    };
    if (!more_.source || images(more_) <= images(fewer_)) return 1;
    double bytes[2] = {0, 0};
    for (const Sample* const sample : {&fewer_, &more_}) {
      CompressRequest request = request_;
      request.weights = sample->weights;
      try {
        bytes[sample == &more_ ? 1 : 0] =
            grown_bytes(*compress(device_, *sample->source, request, quiet_).model, shape_);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::unmet_goal) throw;
        return 1;
      }
    }
    const double power = std::log(bytes[1] / bytes[0]) / std::log(images(more_) / images(fewer_));
    return std::pow(
        static_cast<double>(shape_.images()) / static_cast<double>(part_->info().shape.images()),
        std::clamp(power, 0.0, 1.0));
  }

  // The model of the part of which one of the whole is foreseen to have the wanted size.
  CompressResult by_size() {
    constexpr std::size_t most_rounds = 4;
    constexpr double near = 0.05;
    const double wanted = static_cast<double>(request_.goal.bytes);
    CompressRequest request = request_;
    request.goal.kind = GoalKind::size;
    double bytes = std::max(wanted * share_, 1.0);
    std::optional<CompressResult> found;
    for (std::size_t round = 0; round < most_rounds; ++round) {
      request.goal.bytes = static_cast<std::size_t>(std::ceil(bytes));
      try {
        found = compress(device_, *part_, request, quiet_);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::unmet_goal) throw;
        if (round + 1 == most_rounds && !found) throw;
        bytes *= 3;
        continue;
      }
      const double grown = grown_bytes(*found->model, shape_);
      if (std::abs(grown / wanted - 1) < near) break;
      bytes *= std::clamp(wanted / grown, 0.2, 5.0);
    }
    const double grown = grown_bytes(*found->model, shape_);
    found->goal->reached =
        request_.goal.kind == GoalKind::size ? grown : wanted * request_.goal.value / grown;
    return std::move(*found);
  }

  Device* device_;
  BtfShape shape_;  // of the whole
  CompressRequest request_;
  std::shared_ptr<TileSource> part_;
  // Fewer texels under more directions, and those texels under the part's; none where that says
  // nothing.
  Sample more_;
  Sample fewer_;
  double share_ = 1;  // of the values
  Job quiet_;
};

// Whether the first is to be taken before the second.
bool is_better(const CodecTrial& one, const CodecTrial& other, Preference preference,
               bool goal_is_size) {
  if (one.met != other.met) return one.met;
  if (!one.met) return false;
  switch (preference) {
    case Preference::decode:
      return one.lookups > other.lookups;
    case Preference::encode:
      return one.encode_seconds < other.encode_seconds;
    case Preference::size:
      break;
  }
  return goal_is_size ? one.snr > other.snr : one.bytes < other.bytes;
}

// Compressions of the whole by codecs in the order of what is foreseen, as long as one may be
// better than the best so far.
class Wholes {
 public:
  Wholes(Device* device, TileSource& source, const CompressRequest& request, Preference preference,
         Job& job)
      : device_(device), source_(source), request_(request), preference_(preference), job_(job) {}

  void offer(CodecTrial& trial) {
    constexpr std::size_t most_made = 3;
    if (!trial.met) return;
    if (taken_ && !may_be_better(trial)) {
      trial.outcome = fmt::format("foreseen to be no better than {}", taken_->codec->name());
      return;
    }
    if (taken_ && made_ == most_made) {
      trial.outcome = "not made of the whole";
      return;
    }
    try {
      CompressRequest request = request_;
      request.codec = trial.codec;
      CompressResult result = compress(device_, source_, request, job_);
      ++made_;
      const bool best = !taken_ || is_better(result);
      if (taken_) (best ? *taken_ : trial).outcome = comparison(best ? best_ : result);
      if (!best) return;
      best_ = std::move(result);
      taken_ = &trial;
      trial.outcome = "taken";
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::unmet_goal) throw;
      trial.outcome = error.what();
      job_.notes.push_back(
          fmt::format("codec {}, on the whole: {}", trial.codec->name(), trial.outcome));
    }
  }

  CodecTrial* taken() const { return taken_; }
  CompressResult result() { return std::move(best_); }

 private:
  bool may_be_better(const CodecTrial& trial) const {
    if (preference_ != Preference::size) return false;
    return request_.goal.by_size()
               ? trial.snr > best_.errors.snr
               : trial.bytes < static_cast<double>(model_file_size(*best_.model));
  }
  bool is_better(const CompressResult& result) const {
    return request_.goal.by_size() ? result.errors.snr > best_.errors.snr
                                   : model_file_size(*result.model) < model_file_size(*best_.model);
  }
  // Of one that was made and not taken.
  std::string comparison(const CompressResult& made) const {
    return fmt::format("made of the whole: {} bytes, SNR {:.2f} dB", model_file_size(*made.model),
                       made.errors.snr);
  }

  Device* device_;
  TileSource& source_;
  const CompressRequest& request_;
  Preference preference_;
  Job& job_;
  CodecTrial* taken_ = nullptr;
  CompressResult best_;
  std::size_t made_ = 0;
};

}  // namespace

std::string_view name_of(Preference preference) {
  switch (preference) {
    case Preference::size:
      return "size";
    case Preference::decode:
      return "decode";
    case Preference::encode:
      return "encode";
  }
  return "";
}

double grown_bytes(const Model& part, const BtfShape& whole) {
  const Numbers numbers = numbers_of(part, whole);
  const double bytes = static_cast<double>(model_file_size(part));
  // what is beside the numbers stays; how many bytes quantised ones take is not known apart
  const bool quantised = !part.info.quantised.empty();
  const double of_number = part.info.storage == Storage::f16 ? 2 : 4;
  const double beside = quantised ? 0 : std::max(bytes - of_number * numbers.part, 0.0);
  return beside + (bytes - beside) * numbers.whole / numbers.part;
}

CodecChoice compress_by_best(Device* device, TileSource& source, const CompressRequest& request,
                             Preference preference, Job& job) {
  CodecChoice choice;
  Trials trials(device, source, request, job);
  const BtfShape& shape = trials.part_shape();
  choice.part = fmt::format("{} views x {} lights x {} x {} texels", shape.views, shape.lights,
                            shape.height, shape.width);
  const auto all = codecs();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!all[i]->takes_goals()) continue;
    const StageTimer timer(job, "codecs on a part");
    choice.trials.push_back(trials.trial(*all[i]));
    job.advance("codecs on a part", i + 1, all.size());
  }
  std::stable_sort(choice.trials.begin(), choice.trials.end(),
                   [&](const CodecTrial& one, const CodecTrial& other) {
                     return is_better(one, other, preference, request.goal.by_size());
                   });
  Wholes wholes(device, source, request, preference, job);
  for (CodecTrial& trial : choice.trials) wholes.offer(trial);
  CodecTrial* const taken = wholes.taken();
  if (!taken) {
    std::string reached;
    for (const CodecTrial& trial : choice.trials) {
      reached += fmt::format("\n  {}: {}", trial.codec->name(), trial.outcome);
    }
    fail(ErrorKind::unmet_goal, "--target {}: no codec meets it{}", request.goal.text, reached);
  }
  choice.result = wholes.result();
  job.notes.push_back(fmt::format("codec {}: the best of those that meet {} on {}, by {}",
                                  taken->codec->name(), request.goal.text, choice.part,
                                  name_of(preference)));
  const auto first = choice.trials.begin() + (taken - choice.trials.data());
  std::rotate(choice.trials.begin(), first, first + 1);
  return choice;
}

}  // namespace weft
