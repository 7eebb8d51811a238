// Ranks of a Tucker model from a goal: which slice of the core to give up next.
//
// With orthonormal factors, giving up a slice of the core loses exactly its squared norm
// (Vasilescu & Terzopoulos 2004, eq. (3)). So ranks are cut one by one, always where the least is
// lost per byte that is saved, each mode by itself.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "weft/tensor/float_store.hpp"

namespace weft {

// A mode of so few indices, as channels, is cut last: its factor is left out where it is whole.
inline constexpr std::size_t short_mode = 4;

// What a model takes: its numbers `value_bytes` each, `scale_bytes` for each component, and the
// rest of its file.
struct TuckerBytes {
  std::size_t value_bytes = 2;
  std::size_t scale_bytes = 4;
  std::vector<std::size_t> sizes;     // I_n
  std::vector<std::uint8_t> factors;  // whether mode n has one
  std::function<std::size_t(std::span<const std::size_t>)> header = nullptr;  // of such ranks

  double numbers(std::span<const std::size_t> ranks) const;
  double of(std::span<const std::size_t> ranks) const;
};

struct RankGoal {
  double most_lost = 0;   // of squared norm; not looked at with bytes
  double most_bytes = 0;  // 0: by most_lost
};

// Ranks below those of the core [R_1]...[R_N], each at least 1, as the goal allows, and what
// squared norm is lost with them. Modes without a factor keep theirs. They are cut one by one, with
// and without short modes, and in every equal proportion; the best of these is taken. Slices' norms
// are summed once and lessened by what is cut: about two passes over the core in all.
struct RankChoice {
  std::vector<std::size_t> ranks;
  double lost = 0;
};
RankChoice cut_ranks(std::span<const float> core, std::span<const std::size_t> sizes,
                     const TuckerBytes& bytes, const RankGoal& goal);

// The same before there is a core, from the squared singular values of each mode (descending; none
// for modes that keep theirs), whose tails bound what is lost: eq. (4).
RankChoice cut_ranks(std::span<const std::vector<double>> spectra,
                     std::span<const std::size_t> sizes, const TuckerBytes& bytes,
                     const RankGoal& goal);

// The largest ranks in equal proportion to the modes, rounded, that take no more bytes; 1 each if
// none do. Short modes and those without a factor stay whole.
std::vector<std::size_t> equal_proportion(const TuckerBytes& bytes, double most_bytes);

// The smallest rank, at least 1, with a tail of at most `most_lost`.
std::size_t rank_within(std::span<const double> spectrum, double most_lost);

// The sum of a spectrum from `rank` on, negative values as 0.
double tail(std::span<const double> spectrum, std::size_t rank);

// The leading part [ranks] of a row-major core.
std::vector<float> leading_part(std::span<const float> core, std::span<const std::size_t> sizes,
                                std::span<const std::size_t> ranks);
// The same in place.
void keep_leading_part(FloatStore& core, std::span<const std::size_t> sizes,
                       std::span<const std::size_t> ranks);
// The leading columns of a row-major factor.
std::vector<float> leading_columns(std::span<const float> factor, std::size_t columns,
                                   std::size_t kept);

}  // namespace weft
