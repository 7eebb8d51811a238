#include "weft/codecs/tt_goal.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "weft/btf/selection.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

constexpr double default_tolerance = 0.02;
// Squared relative error of a core that is rounded to half: the mean of (2^-11 / sqrt(3) / m)^2
// over mantissas m in [1, 2), evenly spread in their logarithms, is below this.
constexpr double half_squares = 0x1p-22 / 6;

// The most that bond n can have: the short side of its unfolding.
std::size_t most_rank(const BtfShape& shape, const ModeOrder& order, std::size_t bond) {
  std::size_t left = 1;
  std::size_t right = 1;
  for (std::size_t n = 0; n < mode_count; ++n) {
    (n <= bond ? left : right) *= mode_size(shape, order[n]);
  }
  return std::min(left, right);
}

reference::BondRanks parse_ranks(const std::string& text, const BtfShape& shape,
                                 const ModeOrder& order) {
  std::vector<std::size_t> given;
  std::string_view rest = text;
  while (true) {
    const std::size_t comma = rest.find(',');
    const std::string_view part = rest.substr(0, comma);
    std::size_t value = 0;
    const auto [stop, status] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (status != std::errc() || stop != part.data() + part.size() || value == 0) {
      fail_input("--ranks {}: '{}' is not a rank of at least 1", text, part);
    }
    given.push_back(value);
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  if (given.size() != bond_count) {
    fail_input("--ranks {}: R1,R2,R3,R4 of the bonds between the modes {} are needed", text,
               to_text(order));
  }
  reference::BondRanks ranks{};
  for (std::size_t n = 0; n < bond_count; ++n) {
    const std::size_t most = most_rank(shape, order, n);
    if (given[n] > most) {
      fail_input(
          "--ranks {}: R{} = {}, but {} x {} texels, {} channels, {} views and {} lights in "
          "the order {} have at most {}",
          text, n + 1, given[n], shape.width, shape.height, shape.channels, shape.views,
          shape.lights, to_text(order), most);
    }
    ranks[n] = given[n];
  }
  return ranks;
}

// What the goal allows beside the truncation.
double reserved_squares(double tolerance, Storage storage) {
  if (storage == Storage::f32) return 0;
  return std::min(static_cast<double>(mode_count) * half_squares, 0.1 * tolerance * tolerance);
}

std::unique_ptr<TtModel> fit_to_error(const TtOptions& options, const BtfInfo& source,
                                      Storage storage, const FitTrain& fit,
                                      const MeasureTrain& measure, Job& job) {
  const double goal = options.goal.relative;
  double tightened = 1;
  double found = 0;
  constexpr int most_fits = 3;
  for (int attempt = 0; attempt < most_fits; ++attempt) {
    const double wanted = goal * tightened;
    reference::TrainRequest request;
    request.tolerance = std::sqrt(wanted * wanted - reserved_squares(wanted, storage));
    const TrainFit made = fit(request);
    const double allowed = std::max(wanted * wanted - made.lost, 0.0) * made.squares;
    // as planned, then with all cores in float, if some are not
    for (const double squares : {allowed, 0.0}) {
      auto model = store_train(made.train, options.order, source, storage, squares);
      found = measure(*model);
      if (found <= goal) {
        job.notes.push_back(
            fmt::format("relative error {:.6g} of {:.6g} wanted: truncation left {:.6g}", found,
                        goal, std::sqrt(made.lost)));
        return model;
      }
      const bool all_float = std::all_of(model->stored.begin(), model->stored.end(),
                                         [](Storage s) { return s == Storage::f32; });
      if (all_float) break;
    }
    tightened *= 0.99 * goal / found;
  }
  fail(ErrorKind::unmet_goal, "--target {}: {:.6g} was reached, all that float arithmetic resolves",
       options.goal.text, found);
}

}  // namespace

void describe(TtModel& model, const TtOptions& options) {
  std::string ranks;
  for (std::size_t n = 1; n < mode_count; ++n) {
    ranks += fmt::format("{}{}", n > 1 ? "," : "", model.ranks[n]);
  }
  std::string floats;
  for (std::size_t n = 0; n < mode_count && model.info.storage == Storage::f16; ++n) {
    if (model.stored[n] == Storage::f16) continue;
    floats += fmt::format(R"({}"{}")", floats.empty() ? "" : ",", name_of(model.order[n]));
  }
  model.info.parameters = fmt::format(
      R"({{"target":"{}","order":"{}","kept":[{}],"float_cores":[{}],"texel_operations":{}}})",
      options.goal.text, to_text(model.order), ranks, floats, model.texel_operations());
}

TtOptions tt_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source) {
  TtOptions options;
  const auto given = [&](std::string_view name) -> const std::string* {
    const auto found = parameters.find(name);
    return found == parameters.end() ? nullptr : &found->second;
  };
  if (const std::string* order = given("order")) {
    options.choose_order = *order == "auto";
    if (!options.choose_order) options.order = parse_order(*order, "--order");
  }
  options.goal = fit_goal(parameters, source);
  if (options.goal.kind == FitGoal::Kind::size) {
    fail_input("--target {}: a train of its own search is of a relative error", options.goal.text);
  }
  for (const char* name : {"ranks", "rank"}) {
    const std::string* value = given(name);
    if (value == nullptr) continue;
    if (options.goal) {
      fail_input("--{} {}: --target {} chooses the ranks", name, *value, options.goal.text);
    }
    if (options.ranks[0] > 0) fail_input("--rank {}: --ranks has one for every bond", *value);
    if (options.choose_order && std::string_view(name) == "ranks") {
      fail_input("--ranks {}: --order auto has no bonds to give ranks to", *value);
    }
    if (std::string_view(name) == "ranks") {
      options.ranks = parse_ranks(*value, source.shape, options.order);
      continue;
    }
    const std::size_t rank = count_parameter(codec, parameters, "rank", 1);
    for (std::size_t n = 0; n < bond_count; ++n) {
      options.ranks[n] = std::min(rank, most_rank(source.shape, options.order, n));
    }
  }
  if (!options.goal && options.ranks[0] == 0) {
    options.goal = fit_goal({{"target", fmt::format("rel={}", default_tolerance)}}, source);
  }
  return options;
}

ModeOrder choose_order(Device& device, TileSource& source, const TtOptions& options, Job& job) {
  // Large modes in the middle, and the texels' or the directions' modes side by side.
  constexpr std::array<std::string_view, 8> promising{"x,y,c,v,l", "y,x,c,v,l", "x,y,c,l,v",
                                                      "y,x,c,l,v", "c,x,y,v,l", "x,y,v,l,c",
                                                      "v,x,y,c,l", "l,v,x,y,c"};
  const BtfShape& shape = source.info().shape;
  constexpr std::size_t most_directions = 12;
  constexpr std::size_t most_side = 32;
  const auto every = [](std::size_t size) {
    std::vector<std::size_t> kept;
    const std::size_t step = (size + most_directions - 1) / most_directions;
    for (std::size_t i = 0; i < size; i += step) kept.push_back(i);
    return kept;
  };
  Selection part;
  part.views = every(shape.views);
  if (source.info().layout == Layout::grid) part.lights = every(shape.lights);
  const std::size_t width = std::min(shape.width, most_side);
  const std::size_t height = std::min(shape.height, most_side);
  part.region = Region{(shape.width - width) / 2, (shape.height - height) / 2, width, height};
  const std::shared_ptr<TileSource> sample =
      select(std::shared_ptr<TileSource>(&source, [](TileSource*) {}), part);
  TtFitOptions fit;
  constexpr double usual_error = 0.1;
  fit.request.tolerance = options.goal.relative > 0 ? options.goal.relative : usual_error;
  fit.resident_values = std::numeric_limits<std::size_t>::max();
  ModeOrder best = options.order;
  std::size_t fewest = std::numeric_limits<std::size_t>::max();
  std::string tried;
  for (const std::string_view text : promising) {
    fit.order = parse_order(text, "--order");
    Job quiet;
    quiet.nan_zero = job.nan_zero;
    quiet.memory = job.memory;
    quiet.seed = job.seed;
    const TrainFit made = fit_tt(device, *sample, fit, quiet);
    std::size_t numbers = 0;
    for (std::size_t n = 0; n < mode_count; ++n) {
      numbers += made.train.ranks[n] * mode_size(shape, fit.order[n]) * made.train.ranks[n + 1];
    }
    tried += fmt::format("{}{} {}", tried.empty() ? "" : "; ", text, numbers);
    if (numbers < fewest) {
      fewest = numbers;
      best = fit.order;
    }
  }
  job.notes.push_back(
      fmt::format("order {}: the fewest numbers by a sample ({})", to_text(best), tried));
  return best;
}

TrainFit fit_beyond(double coefficients, const FitTrain& fit, std::size_t& fits, Job& job) {
  constexpr double loosest = 0.5;
  constexpr double tightest = 1e-5;
  double tolerance = loosest;
  double tolerance_before = 1;
  double before = 0;  // numbers at that
  for (;;) {
    reference::TrainRequest request;
    request.tolerance = tolerance;
    TrainFit made = fit(request);
    ++fits;
    const double numbers = static_cast<double>(made.train.coefficients());
    job.notes.push_back(fmt::format("relative error {:.4g} takes {} numbers", std::sqrt(made.lost),
                                    made.train.coefficients()));
    const double missing = coefficients / numbers;
    if (missing <= 1 || tolerance <= tightest) return made;
    // Sizes grow about as a power of the error, which the last two fits tell. The first says
    // little.
    constexpr double first_slope = 2;
    constexpr double beyond = 0.95;
    const double slope =
        before == 0
            ? first_slope
            : std::max(std::log(numbers / before) / std::log(tolerance_before / tolerance), 1.0);
    const double step =
        std::clamp(beyond * std::pow(missing, -1 / slope), before == 0 ? 0.5 : 0.2, 0.9);
    before = numbers;
    tolerance_before = tolerance;
    tolerance = std::max(tolerance * step, tightest);
  }
}

std::vector<TrainCut> train_cuts(const TensorTrain& train) {
  std::array<std::size_t, mode_count + 1> ranks = train.ranks;
  double lost = 0;
  std::vector<TrainCut> cuts;
  for (;;) {
    TrainCut cut;
    std::copy(ranks.begin() + 1, ranks.end() - 1, cut.ranks.begin());
    for (std::size_t n = 0; n < mode_count; ++n) {
      cut.coefficients += ranks[n] * train.sizes[n] * ranks[n + 1];
    }
    cut.lost = lost;
    cuts.push_back(cut);
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t bond = 1; bond <= bond_count; ++bond) {
      if (ranks[bond] == 1) continue;
      const double value = train.values[bond - 1][ranks[bond] - 1];
      const double saved = static_cast<double>(ranks[bond - 1] * train.sizes[bond - 1] +
                                               train.sizes[bond] * ranks[bond + 1]);
      if (value * value / saved < least) {
        least = value * value / saved;
        best = bond;
      }
    }
    if (best == 0) return cuts;
    const std::array<std::size_t, mode_count + 1> whole = ranks;
    --ranks[best];
    // No bond holds more than a neighbour's with the mode between them.
    for (std::size_t n = 1; n < mode_count; ++n) {
      ranks[n] = std::min(ranks[n], ranks[n - 1] * train.sizes[n - 1]);
    }
    for (std::size_t n = bond_count; n > 0; --n) {
      ranks[n] = std::min(ranks[n], train.sizes[n] * ranks[n + 1]);
    }
    for (std::size_t bond = 1; bond <= bond_count; ++bond) {
      for (std::size_t j = ranks[bond]; j < whole[bond]; ++j) {
        lost += train.values[bond - 1][j] * train.values[bond - 1][j];
      }
    }
  }
}

std::unique_ptr<TtModel> fit_to_goal(const TtOptions& options, const BtfInfo& source,
                                     Storage storage, const FitTrain& fit,
                                     const MeasureTrain& measure, Job& job) {
  std::unique_ptr<TtModel> model;
  if (options.goal.kind == FitGoal::Kind::relative) {
    model = fit_to_error(options, source, storage, fit, measure, job);
  } else {
    reference::TrainRequest request;
    request.ranks = options.ranks;
    const TrainFit made = fit(request);
    for (std::size_t n = 0; n < bond_count; ++n) {
      if (made.train.ranks[n + 1] < options.ranks[n]) {
        job.notes.push_back(fmt::format("R{} = {} asked, {} kept: the data holds no more", n + 1,
                                        options.ranks[n], made.train.ranks[n + 1]));
      }
    }
    model = store_train(made.train, options.order, source, storage,
                        std::numeric_limits<double>::infinity());
  }
  describe(*model, options);
  return model;
}

}  // namespace weft
