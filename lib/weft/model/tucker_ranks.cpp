#include "weft/model/tucker_ranks.hpp"

#include <algorithm>
#include <functional>
#include <limits>

namespace weft {
namespace {

using Loss = std::function<double(const std::vector<std::size_t>&, std::size_t)>;

// Cuts one rank at a time while the goal asks for it or allows it. `loss` says what is lost by
// cutting mode n of the given ranks by one.
RankChoice cut(std::span<const std::size_t> sizes, const TuckerBytes& bytes, const RankGoal& goal,
               const std::vector<std::uint8_t>& modes, const Loss& loss) {
  RankChoice choice{{sizes.begin(), sizes.end()}, 0};
  std::vector<std::size_t>& ranks = choice.ranks;
  while (goal.most_bytes == 0 || bytes.of(ranks) > goal.most_bytes) {
    const double held = bytes.of(ranks);
    double best = std::numeric_limits<double>::infinity();
    double best_loss = 0;
    std::size_t mode = ranks.size();
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      if (modes[n] == 0 || ranks[n] == 1) continue;
      const double lost = loss(ranks, n);
      if (goal.most_bytes == 0 && choice.lost + lost > goal.most_lost) continue;
      --ranks[n];
      // the first cut of a short mode may cost more than it saves
      const double saved = std::max(1.0, held - bytes.of(ranks));
      ++ranks[n];
      if (lost / saved < best) {
        best = lost / saved;
        best_loss = lost;
        mode = n;
      }
    }
    if (mode == ranks.size()) break;
    --ranks[mode];
    choice.lost += best_loss;
  }
  return choice;
}

// Squared norm of the last slice of mode n in the leading part `ranks` of a core.
double slice_squares(std::span<const float> core, std::span<const std::size_t> sizes,
                     const std::vector<std::size_t>& ranks, std::size_t n, std::size_t mode,
                     std::size_t offset) {
  if (mode + 1 == sizes.size()) {
    const std::size_t first = offset * sizes[mode];
    double sum = 0;
    for (std::size_t i = n == mode ? ranks[mode] - 1 : 0; i < ranks[mode]; ++i) {
      sum += double{core[first + i]} * double{core[first + i]};
    }
    return sum;
  }
  double sum = 0;
  for (std::size_t i = n == mode ? ranks[mode] - 1 : 0; i < ranks[mode]; ++i) {
    sum += slice_squares(core, sizes, ranks, n, mode + 1, offset * sizes[mode] + i);
  }
  return sum;
}

// Squared norm of the leading part `ranks` of a core.
double part_squares(std::span<const float> core, std::span<const std::size_t> sizes,
                    const std::vector<std::size_t>& ranks, std::size_t mode = 0,
                    std::size_t offset = 0) {
  double sum = 0;
  for (std::size_t i = 0; i < ranks[mode]; ++i) {
    const std::size_t at = offset * sizes[mode] + i;
    sum += mode + 1 == sizes.size() ? double{core[at]} * double{core[at]}
                                    : part_squares(core, sizes, ranks, mode + 1, at);
  }
  return sum;
}

// The modes that may be cut, without short ones.
std::vector<std::uint8_t> longer_modes(const TuckerBytes& bytes) {
  std::vector<std::uint8_t> modes = bytes.factors;
  for (std::size_t n = 0; n < modes.size(); ++n) {
    if (bytes.sizes[n] <= short_mode) modes[n] = 0;
  }
  return modes;
}

void copy_part(std::span<const float> core, std::span<const std::size_t> sizes,
               std::span<const std::size_t> ranks, std::size_t mode, std::size_t offset,
               std::vector<float>& part) {
  if (mode + 1 == sizes.size()) {
    const auto row = core.begin() + static_cast<std::ptrdiff_t>(offset * sizes[mode]);
    part.insert(part.end(), row, row + static_cast<std::ptrdiff_t>(ranks[mode]));
    return;
  }
  for (std::size_t i = 0; i < ranks[mode]; ++i) {
    copy_part(core, sizes, ranks, mode + 1, offset * sizes[mode] + i, part);
  }
}

}  // namespace

double TuckerBytes::of(std::span<const std::size_t> ranks) const {
  double core = 1;
  double rest = static_cast<double>(ranks[0] * scale_bytes);
  for (std::size_t n = 0; n < ranks.size(); ++n) {
    core *= static_cast<double>(ranks[n]);
    const bool whole = sizes[n] <= short_mode && ranks[n] == sizes[n];
    if (factors[n] != 0 && !whole) {
      rest += static_cast<double>(ranks[n] * (sizes[n] * value_bytes + scale_bytes));
    }
  }
  return core * static_cast<double>(value_bytes) + rest;
}

RankChoice cut_ranks(std::span<const float> core, std::span<const std::size_t> sizes,
                     const TuckerBytes& bytes, const RankGoal& goal) {
  const Loss loss = [&](const std::vector<std::size_t>& ranks, std::size_t n) {
    return slice_squares(core, sizes, ranks, n, 0, 0);
  };
  const double all =
      part_squares(core, sizes, std::vector<std::size_t>(sizes.begin(), sizes.end()));
  const bool by_bytes = goal.most_bytes > 0;
  const auto meets = [&](const RankChoice& choice) {
    return by_bytes ? bytes.of(choice.ranks) <= goal.most_bytes : choice.lost <= goal.most_lost;
  };
  RankChoice best = cut(sizes, bytes, goal, bytes.factors, loss);
  const auto offer = [&](RankChoice choice) {
    if (!meets(choice)) return;
    const bool better =
        by_bytes ? choice.lost < best.lost : bytes.of(choice.ranks) < bytes.of(best.ranks);
    if (better || !meets(best)) best = std::move(choice);
  };
  // A slice of a short mode is a large part of the core: once without those.
  const std::vector<std::uint8_t> longer = longer_modes(bytes);
  if (longer != bytes.factors) offer(cut(sizes, bytes, goal, longer, loss));
  // Ranks in equal proportion to the modes: the smallest of 256 proportions that loses no more than
  // it may, or the largest that fits.
  const auto proportional = [&](std::size_t part) {
    RankChoice choice{{sizes.begin(), sizes.end()}, 0};
    for (std::size_t n = 0; n < sizes.size(); ++n) {
      if (longer[n] == 0) continue;
      choice.ranks[n] = std::clamp<std::size_t>((bytes.sizes[n] * part + 128) / 256, 1, sizes[n]);
    }
    choice.lost = all - part_squares(core, sizes, choice.ranks);
    return choice;
  };
  std::size_t low = 0;
  std::size_t high = 256;
  while (high - low > 1) {
    const std::size_t middle = (low + high) / 2;
    const RankChoice choice = proportional(middle);
    offer(choice);
    (meets(choice) == by_bytes ? low : high) = middle;
  }
  return best;
}

RankChoice cut_ranks(std::span<const std::vector<double>> spectra,
                     std::span<const std::size_t> sizes, const TuckerBytes& bytes,
                     const RankGoal& goal) {
  return cut(sizes, bytes, goal, longer_modes(bytes),
             [&](const std::vector<std::size_t>& ranks, std::size_t n) {
               return std::max(0.0, spectra[n][ranks[n] - 1]);
             });
}

double tail(std::span<const double> spectrum, std::size_t rank) {
  double sum = 0;
  for (std::size_t i = spectrum.size(); i-- > rank;) sum += std::max(0.0, spectrum[i]);
  return sum;
}

std::size_t rank_within(std::span<const double> spectrum, double most_lost) {
  std::size_t rank = spectrum.size();
  double lost = 0;
  while (rank > 1) {
    lost += std::max(0.0, spectrum[rank - 1]);
    if (lost > most_lost) break;
    --rank;
  }
  return rank;
}

std::vector<float> leading_part(std::span<const float> core, std::span<const std::size_t> sizes,
                                std::span<const std::size_t> ranks) {
  std::vector<float> part;
  std::size_t count = 1;
  for (const std::size_t rank : ranks) count *= rank;
  part.reserve(count);
  copy_part(core, sizes, ranks, 0, 0, part);
  return part;
}

std::vector<float> leading_columns(std::span<const float> factor, std::size_t columns,
                                   std::size_t kept) {
  std::vector<float> part;
  part.reserve(factor.size() / columns * kept);
  for (std::size_t i = 0; i < factor.size(); i += columns) {
    const auto row = factor.begin() + static_cast<std::ptrdiff_t>(i);
    part.insert(part.end(), row, row + static_cast<std::ptrdiff_t>(kept));
  }
  return part;
}

}  // namespace weft
