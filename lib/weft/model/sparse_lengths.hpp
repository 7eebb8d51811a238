// Which list lengths k1 and k2 reach a goal (Ruiters & Klein 2009, section 4.2): errors of shorter
// lists from one decomposition with long ones, and the choices by the sum of both.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "weft/model/sparse_lists.hpp"

namespace weft {

// |Y - X_m D|^2 for m = 0 .. length, X_m the least squares codes on the first m terms of each
// signal's list. Where these are in the order of a pursuit, X_m is what orthogonal matching pursuit
// gives for m terms. Estimated from at most `most_signals` rows of Y, evenly spread; never
// increasing with m.
//   Y: [signals][dimension]; D: [atoms][dimension]
std::vector<double> truncation_errors(std::size_t dimension, std::span<const float> Y,
                                      std::span<const float> D, const CodeLists& codes,
                                      std::size_t most_signals = 1024);

struct SparseLengthChoice {
  std::size_t view_terms = 0;   // k1
  std::size_t texel_terms = 0;  // k2
  double squares = 0;           // foreseen squared error of both
  std::size_t bytes = 0;
};

// Of all k1, k2 >= 1 with view_errors[k1] and texel_errors[k2]: those than which no other takes as
// few bytes and leaves as little, by ascending bytes and descending error. The best within a size
// is the last whose bytes fit, the fewest bytes for an error are the first whose squares fit.
using LengthBytes = std::function<std::size_t(std::size_t view_terms, std::size_t texel_terms)>;
std::vector<SparseLengthChoice> best_lengths(std::span<const double> view_errors,
                                             std::span<const double> texel_errors,
                                             const LengthBytes& bytes);

}  // namespace weft
