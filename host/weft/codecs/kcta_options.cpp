#include "weft/codecs/kcta_options.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <span>
#include <string>

#include "weft/btf/view_grid.hpp"
#include "weft/codecs/rank_options.hpp"
#include "weft/error.hpp"
#include "weft/model/tucker_ranks.hpp"

namespace weft {
namespace {

constexpr std::size_t default_clusters = 8;
constexpr std::size_t default_mixtures = 3;
constexpr std::size_t default_slice_rank = 4;  // as the paper has it
constexpr std::size_t default_rank = 32;

KctaStart start_from(std::string_view text) {
  for (const KctaStart start : {KctaStart::directions, KctaStart::slices, KctaStart::random}) {
    if (text == name_of(start)) return start;
  }
  fail_input("--init {}: directions, slices or random is needed", text);
}

// Which groups have one basis for all clusters.
std::vector<std::uint8_t> global_modes(const KctaRequest& request, std::string_view text) {
  std::vector<std::uint8_t> global(request.groups.count(), 0);
  const std::string option = fmt::format("--global {}", text);
  if (text.empty()) global[request.groups.group_of(Mode::light)] = 1;
  if (text.empty() || text == "none") return global;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::size_t n = request.groups.find(text.substr(at, end - at), option);
    const std::string& name = request.groups.groups()[n].name;
    if (n == request.mode) fail_input("{}: mode {} is that of the clusters", option, name);
    if (global[n] != 0) fail_input("{}: mode {} is named twice", option, name);
    global[n] = 1;
    at = end + 1;
  }
  return global;
}

// Groups, the clustered mode and global ones: what the others are counted in.
KctaRequest modes_of(const Codec& codec, const Parameters& parameters, const BtfInfo& source) {
  KctaRequest request;
  const std::string_view merge = value_of(codec, parameters, "merge");
  request.groups = ModeGroups(source.shape, merge == "none" ? std::string_view() : merge);
  const std::string_view mode = value_of(codec, parameters, "mode");
  request.mode = request.groups.find(mode, fmt::format("--mode {}", mode));
  request.global_mode = global_modes(request, value_of(codec, parameters, "global"));
  request.ranks = named_ranks(request.groups, value_of(codec, parameters, "ranks"));
  return request;
}

// 0 without one.
double threshold_of(const Codec& codec, const Parameters& parameters) {
  const std::string text(value_of(codec, parameters, "threshold"));
  if (text.empty()) return 0;
  double value = 0;
  const auto [stop, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc() || stop != text.data() + text.size() || !(value > 0 && value < 1)) {
    fail_input("--threshold {}: a number between 0 and 1 is needed", text);
  }
  return value;
}

std::size_t chosen_rank(std::span<const double> spectrum, double threshold, std::size_t align,
                        std::size_t size) {
  if (spectrum.empty() || threshold == 0) return size;
  const std::size_t rank = rank_within(spectrum, threshold * threshold * tail(spectrum, 0));
  return std::min((rank + align - 1) / align * align, size);
}

// How ranks that are not given are chosen: by a threshold, of a goal or the user's, or not.
struct Choice {
  bool by_threshold = false;
  bool of_goal = false;
  KctaGoal goal;
};

void check_length(const KctaRequest& request, std::size_t n) {
  const ModeGroup& group = request.groups.groups()[n];
  const bool local = request.cuts(n) && request.global_mode[n] == 0;
  if ((!local && n != request.mode) || group.size <= longest_kcta_mode) return;
  fail_input("--{}: mode {} of size {} is too long for {}, at most {}",
             n == request.mode ? "mode" : "ranks", group.name, group.size,
             n == request.mode ? "clusters" : "bases of each cluster; give it a global one or none",
             longest_kcta_mode);
}

std::size_t grid_side_of(const Codec& codec, const Parameters& parameters,
                         const KctaRequest& request) {
  const std::size_t side = count_parameter(codec, parameters, "resample-views", 0);
  if (side > most_grid_side) {
    fail_input("--resample-views {}: a side of at most {} is taken", side, most_grid_side);
  }
  const ModeGroup& slices = request.groups.groups()[request.mode];
  if (side > 0 && slices.name != "v") {
    fail_input("--resample-views {}: clusters are of mode {}, not of views", side, slices.name);
  }
  return side;
}

KctaRequest options_by(const Codec& codec, const Parameters& parameters, const BtfInfo& source,
                       const ModeSpectra& spectra, const Choice& choice) {
  KctaRequest request = modes_of(codec, parameters, source);
  request.start = start_from(value_of(codec, parameters, "init"));
  request.iterations = count_parameter(codec, parameters, "iterations", 0);
  const std::size_t align = count_parameter(codec, parameters, "align", 1);
  const auto chosen = [&](std::size_t n) {
    return chosen_rank(spectra.empty() ? std::span<const double>() : std::span(spectra[n]),
                       choice.goal.threshold, align, request.groups.groups()[n].size);
  };

  request.grid_side = grid_side_of(codec, parameters, request);

  // ranks
  std::size_t others = 0;
  if (parameters.contains("rank")) others = count_parameter(codec, parameters, "rank", 1);
  for (std::size_t n = 0; n < request.ranks.size(); ++n) {
    const ModeGroup& group = request.groups.groups()[n];
    const std::size_t given = request.ranks[n] > 0 ? request.ranks[n] : others;
    std::size_t rank = given;
    if (n == request.mode) {
      if (given == 0) rank = default_slice_rank;
    } else if (choice.of_goal) {
      rank = given > 0 ? std::min(given, chosen(n)) : chosen(n);
    } else if (given == 0) {
      rank = choice.by_threshold ? chosen(n) : default_rank;
    }
    request.ranks[n] = std::min(rank, group.size);
    check_length(request, n);
  }

  // clusters
  const ModeGroup& clustered = request.groups.groups()[request.mode];
  const std::size_t rank = request.ranks[request.mode];
  request.clusters = default_clusters;
  if (choice.by_threshold) {
    const std::size_t fitting = (chosen(request.mode) + rank - 1) / rank;
    const double wanted = static_cast<double>(fitting) * choice.goal.growth;
    request.clusters =
        static_cast<std::size_t>(std::min(wanted, static_cast<double>(clustered.size)));
  }
  request.clusters = std::min(request.clusters, clustered.size);
  if (parameters.contains("clusters")) {
    request.clusters = count_parameter(codec, parameters, "clusters", 1);
    if (request.clusters > clustered.size) {
      fail_input("--clusters {}: mode {} has {} slices", request.clusters, clustered.name,
                 clustered.size);
    }
  }
  const auto specs = codec.parameters();
  const bool mixes = std::any_of(specs.begin(), specs.end(),
                                 [](const ParameterSpec& spec) { return spec.name == "mixtures"; });
  if (mixes) request.mixtures = std::min(default_mixtures, request.clusters);
  if (mixes && parameters.contains("mixtures")) {
    request.mixtures = count_parameter(codec, parameters, "mixtures", 1);
    // a goal that needs few clusters has no more of them to mix
    const bool clamps = choice.of_goal && !parameters.contains("clusters");
    if (clamps) request.mixtures = std::min(request.mixtures, clustered.size);
    if (clamps) request.clusters = std::max(request.clusters, request.mixtures);
    if (request.mixtures > request.clusters) {
      fail_input("--mixtures {}: there are {} clusters", request.mixtures, request.clusters);
    }
  }
  return request;
}

}  // namespace

std::vector<std::size_t> modes_to_choose(const Codec& codec, const Parameters& parameters,
                                         const BtfInfo& source) {
  const KctaRequest request = modes_of(codec, parameters, source);
  std::vector<std::size_t> modes;
  if (threshold_of(codec, parameters) == 0) return modes;
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    const ModeGroup& group = request.groups.groups()[n];
    const bool asked = n == request.mode ? !parameters.contains("clusters")
                                         : request.ranks[n] == 0 && !parameters.contains("rank");
    if (!asked || group.size == 1) continue;
    if (group.size > longest_kcta_mode) {
      fail_input("--threshold {}: mode {} of size {} is too long to choose its rank, at most {}",
                 parameters.at("threshold"), group.name, group.size, longest_kcta_mode);
    }
    modes.push_back(n);
  }
  return modes;
}

std::vector<std::size_t> modes_of_goal(const Codec& codec, const Parameters& parameters,
                                       const BtfInfo& source) {
  if (threshold_of(codec, parameters) > 0) {
    fail_input("--threshold {}: --target chooses the ranks", parameters.at("threshold"));
  }
  const KctaRequest request = modes_of(codec, parameters, source);
  std::vector<std::size_t> modes;
  for (std::size_t n = 0; n < request.groups.count(); ++n) {
    const ModeGroup& group = request.groups.groups()[n];
    const bool asked = n != request.mode || !parameters.contains("clusters");
    // longer ones stay as they are given, or whole
    if (asked && group.size > 1 && group.size <= longest_kcta_mode) modes.push_back(n);
  }
  return modes;
}

KctaRequest kcta_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source,
                         const ModeSpectra& spectra) {
  const double threshold = threshold_of(codec, parameters);
  return options_by(codec, parameters, source, spectra, {threshold > 0, false, {threshold, 1}});
}

KctaRequest kcta_options(const Codec& codec, const Parameters& parameters, const BtfInfo& source,
                         const ModeSpectra& spectra, const KctaGoal& goal) {
  return options_by(codec, parameters, source, spectra, {true, true, goal});
}

std::string kcta_bounds(const Codec& codec, const Parameters& parameters,
                        const KctaRequest& largest) {
  std::string ranks;
  for (std::size_t n = 0; n < largest.ranks.size(); ++n) {
    const bool given = parameters.contains("rank") ||
                       named_ranks(largest.groups, value_of(codec, parameters, "ranks"))[n] > 0;
    if (n == largest.mode || !given || !largest.cuts(n)) continue;
    ranks += fmt::format("{}{}={}", ranks.empty() ? "" : ",", largest.groups.groups()[n].name,
                         largest.ranks[n]);
  }
  std::string bounds;
  if (!ranks.empty()) bounds = "the ranks given, " + ranks;
  if (parameters.contains("clusters")) {
    bounds += fmt::format("{}--clusters {}", bounds.empty() ? "" : ", and ", largest.clusters);
  }
  return bounds.empty() ? "all that float arithmetic resolves" : bounds;
}

}  // namespace weft
