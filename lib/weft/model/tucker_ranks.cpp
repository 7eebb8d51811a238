#include "weft/model/tucker_ranks.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "weft/tensor/sizes.hpp"

namespace weft {
namespace {

// Squared norms of the slices of each mode: [mode][index].
using Slices = std::vector<std::vector<double>>;

// Cuts one rank at a time while the goal asks for it or allows it. Cutting mode n of the given
// ranks by one loses its last slice; `lessen` takes that out of the other modes' slices.
template <typename Lessen>
RankChoice cut(std::span<const std::size_t> sizes, const TuckerBytes& bytes, const RankGoal& goal,
               const std::vector<std::uint8_t>& modes, Slices slices, const Lessen& lessen) {
  RankChoice choice{{sizes.begin(), sizes.end()}, 0};
  std::vector<std::size_t>& ranks = choice.ranks;
  while (goal.most_bytes == 0 || bytes.of(ranks) > goal.most_bytes) {
    const double held = bytes.numbers(ranks);
    double best = std::numeric_limits<double>::infinity();
    double best_loss = 0;
    std::size_t mode = ranks.size();
    for (std::size_t n = 0; n < ranks.size(); ++n) {
      if (modes[n] == 0 || ranks[n] == 1) continue;
      const double lost = std::max(0.0, slices[n][ranks[n] - 1]);
      if (goal.most_bytes == 0 && choice.lost + lost > goal.most_lost) continue;
      --ranks[n];
      // the first cut of a short mode may cost more than it saves
      const double saved = std::max(1.0, held - bytes.numbers(ranks));
      ++ranks[n];
      if (lost / saved < best) {
        best = lost / saved;
        best_loss = lost;
        mode = n;
      }
    }
    if (mode == ranks.size()) break;
    lessen(slices, ranks, mode);
    --ranks[mode];
    choice.lost += best_loss;
  }
  return choice;
}

// Calls use(index, row) for every row of neighbours of a core's leading part `ranks`, or of the
// last slice of mode `last` in it.
template <typename Use>
void for_each_row(std::span<const float> core, std::span<const std::size_t> sizes,
                  std::span<const std::size_t> ranks, std::size_t last, const Use& use) {
  const std::size_t rows = sizes.size() - 1;
  std::vector<std::size_t> index(sizes.size(), 0);
  if (last < index.size()) index[last] = ranks[last] - 1;
  for (;;) {
    std::size_t offset = 0;
    for (std::size_t n = 0; n < rows; ++n) offset = offset * sizes[n] + index[n];
    const std::size_t first = index[rows];
    use(index, core.subspan(offset * sizes[rows] + first, ranks[rows] - first));
    std::size_t n = rows;
    while (n-- > 0) {
      if (n == last) continue;
      if (++index[n] < ranks[n]) break;
      index[n] = 0;
    }
    if (n == static_cast<std::size_t>(-1)) return;
  }
}

// Adds the squares of a row to those of its places; returns their sum.
double add_squares(std::span<const float> row, double* places) {
  double sums[4] = {0, 0, 0, 0};
  std::size_t i = 0;
  for (; i + 4 <= row.size(); i += 4) {
    for (std::size_t j = 0; j < 4; ++j) {
      const double square = double{row[i + j]} * double{row[i + j]};
      places[i + j] += square;
      sums[j] += square;
    }
  }
  for (; i < row.size(); ++i) {
    const double square = double{row[i]} * double{row[i]};
    places[i] += square;
    sums[0] += square;
  }
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// Takes the last slice of mode n of a core's leading part out of the other modes' slices.
void lessen_slices(std::span<const float> core, std::span<const std::size_t> sizes, Slices& slices,
                   std::span<const std::size_t> ranks, std::size_t n) {
  const std::size_t last = sizes.size() - 1;
  std::vector<double> places(sizes[last], 0.0);
  for_each_row(core, sizes, ranks, n, [&](const auto& index, std::span<const float> row) {
    const double squares = add_squares(row, places.data());
    for (std::size_t m = 0; m < last; ++m) {
      if (m != n) slices[m][index[m]] -= squares;
    }
  });
  if (n == last) return;
  for (std::size_t i = 0; i < places.size(); ++i) slices[last][i] -= places[i];
}

// The modes that may be cut, without short ones.
std::vector<std::uint8_t> longer_modes(const TuckerBytes& bytes) {
  std::vector<std::uint8_t> modes = bytes.factors;
  for (std::size_t n = 0; n < modes.size(); ++n) {
    if (bytes.sizes[n] <= short_mode) modes[n] = 0;
  }
  return modes;
}

// Ranks in equal proportion to the modes that take part, ascending: round(I_n t) for every t that
// makes one of them another.
std::vector<std::vector<std::size_t>> proportions(std::span<const std::size_t> modes,
                                                  std::span<const std::uint8_t> take_part) {
  struct Step {
    std::size_t numerator;  // t = numerator / (2 size)
    std::size_t size;
  };
  std::vector<Step> steps;
  for (std::size_t n = 0; n < modes.size(); ++n) {
    if (take_part[n] == 0) continue;
    for (std::size_t k = 1; k <= modes[n]; ++k) steps.push_back({2 * k - 1, modes[n]});
  }
  std::sort(steps.begin(), steps.end(), [](const Step& a, const Step& b) {
    return a.numerator * b.size < b.numerator * a.size;
  });
  std::vector<std::vector<std::size_t>> levels;
  for (const Step& step : steps) {
    std::vector<std::size_t> ranks(modes.begin(), modes.end());
    for (std::size_t n = 0; n < modes.size(); ++n) {
      if (take_part[n] == 0) continue;
      ranks[n] =
          std::max<std::size_t>(1, (modes[n] * step.numerator + step.size) / (2 * step.size));
    }
    if (levels.empty() || levels.back() != ranks) levels.push_back(std::move(ranks));
  }
  return levels;
}

// What a core's rows say of its slices, and of ranks in equal proportion.
struct CoreSums {
  Slices slices;
  std::vector<std::vector<std::size_t>> levels;  // none longer than the core
  std::vector<double> lost;                      // beyond each level
};

CoreSums sums_of(std::span<const float> core, std::span<const std::size_t> sizes,
                 std::vector<std::vector<std::size_t>> levels) {
  CoreSums sums;
  sums.levels = std::move(levels);
  const std::size_t last = sizes.size() - 1;
  std::vector<std::vector<std::size_t>> entry(sizes.size());  // the level that first holds an index
  for (std::size_t n = 0; n < sizes.size(); ++n) {
    sums.slices.emplace_back(sizes[n], 0.0);
    for (std::size_t level = 0; level < sums.levels.size(); ++level) {
      std::size_t& rank = sums.levels[level][n];
      rank = std::min(rank, sizes[n]);
      while (entry[n].size() < rank) entry[n].push_back(level);
    }
    entry[n].resize(sizes[n], sums.levels.size());
  }
  std::vector<double> squares(sums.levels.size() + 1, 0.0);  // that enter with each level
  std::vector<double> late(sizes[last], 0.0);  // of places that enter later than their row
  const std::vector<std::size_t> whole(sizes.begin(), sizes.end());
  for_each_row(
      core, sizes, whole, sizes.size(), [&](const auto& index, std::span<const float> row) {
        std::size_t level = 0;
        for (std::size_t m = 0; m < last; ++m) {
          level = std::max(level, entry[m][index[m]]);
        }
        const auto early = static_cast<std::size_t>(
            std::upper_bound(entry[last].begin(), entry[last].end(), level) - entry[last].begin());
        double* places = sums.slices[last].data();
        const double first = add_squares(row.first(early), places);
        const double rest = add_squares(row.subspan(early), late.data() + early);
        squares[level] += first;
        for (std::size_t m = 0; m < last; ++m) sums.slices[m][index[m]] += first + rest;
      });
  for (std::size_t i = 0; i < late.size(); ++i) {
    sums.slices[last][i] += late[i];
    squares[entry[last][i]] += late[i];
  }
  sums.lost.assign(sums.levels.size(), 0.0);
  double lost = 0;
  for (std::size_t level = sums.levels.size(); level-- > 0;) {
    lost += squares[level + 1];
    sums.lost[level] = lost;
  }
  return sums;
}

// Copies the leading part to `to`, which may be where the core begins.
void copy_part(std::span<const float> core, std::span<const std::size_t> sizes,
               std::span<const std::size_t> ranks, float* to) {
  for_each_row(core, sizes, ranks, sizes.size(), [&](const auto&, std::span<const float> row) {
    if (to != row.data()) std::copy(row.begin(), row.end(), to);
    to += row.size();
  });
}

}  // namespace

double TuckerBytes::of(std::span<const std::size_t> ranks) const {
  return numbers(ranks) + (header ? static_cast<double>(header(ranks)) : 0.0);
}

double TuckerBytes::numbers(std::span<const std::size_t> ranks) const {
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
  const std::vector<std::uint8_t> longer = longer_modes(bytes);
  const CoreSums sums = sums_of(core, sizes, proportions(bytes.sizes, longer));
  const bool by_bytes = goal.most_bytes > 0;
  const auto meets = [&](const RankChoice& choice) {
    return by_bytes ? bytes.of(choice.ranks) <= goal.most_bytes : choice.lost <= goal.most_lost;
  };
  const auto lessen = [&](Slices& slices, std::span<const std::size_t> ranks, std::size_t n) {
    lessen_slices(core, sizes, slices, ranks, n);
  };
  RankChoice best = cut(sizes, bytes, goal, bytes.factors, sums.slices, lessen);
  const auto offer = [&](RankChoice choice) {
    if (!meets(choice)) return;
    const bool better =
        by_bytes ? choice.lost < best.lost : bytes.of(choice.ranks) < bytes.of(best.ranks);
    if (better || !meets(best)) best = std::move(choice);
  };
  // A slice of a short mode is a large part of the core: once without those.
  if (longer != bytes.factors) offer(cut(sizes, bytes, goal, longer, sums.slices, lessen));
  for (std::size_t level = 0; level < sums.levels.size(); ++level) {
    RankChoice choice{{sizes.begin(), sizes.end()}, sums.lost[level]};
    for (std::size_t n = 0; n < sizes.size(); ++n) {
      if (longer[n] != 0) choice.ranks[n] = sums.levels[level][n];
    }
    offer(std::move(choice));
  }
  return best;
}

RankChoice cut_ranks(std::span<const std::vector<double>> spectra,
                     std::span<const std::size_t> sizes, const TuckerBytes& bytes,
                     const RankGoal& goal) {
  return cut(sizes, bytes, goal, longer_modes(bytes), Slices(spectra.begin(), spectra.end()),
             [](const Slices&, std::span<const std::size_t>, std::size_t) {});
}

std::vector<std::size_t> equal_proportion(const TuckerBytes& bytes, double most_bytes) {
  std::vector<std::size_t> best(bytes.sizes.size(), 1);
  for (const std::vector<std::size_t>& ranks : proportions(bytes.sizes, longer_modes(bytes))) {
    if (bytes.of(ranks) <= most_bytes) best = ranks;
  }
  return best;
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
  std::vector<float> part(product(ranks));
  copy_part(core, sizes, ranks, part.data());
  return part;
}

void keep_leading_part(FloatStore& core, std::span<const std::size_t> sizes,
                       std::span<const std::size_t> ranks) {
  copy_part(core, sizes, ranks, core.data());
  core.shrink(product(ranks));
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
