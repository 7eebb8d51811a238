// Which atoms K-SVD begins with, and which it replaces by what: shared by the reference and the
// device, since their fits could not be compared otherwise.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "weft/reference/ksvd.hpp"

namespace weft::reference {

// Gives one signal of many.
struct SignalReader {
  std::size_t signals = 0;
  std::size_t dimension = 0;
  std::function<void(std::size_t signal, std::span<double> values)> read;
};

// Atoms of which two are taken for the same: |d_i . d_j| above this.
inline constexpr double duplicate_atoms = 0.99;

// Throws an input error unless there is something to fit: sizes that are zero, a given dictionary
// of another size.
void check_ksvd(std::size_t signals, std::size_t dimension, const KsvdOptions& options,
                std::size_t given_values);

// The dictionary that options.start asks for, [atoms][dimension], unit atoms. Signals of norm zero
// are passed over; where there are not enough others, atoms are random. Throws an input error that
// locates a NaN or infinity of `given`.
std::vector<double> initial_atoms(const SignalReader& signals, const KsvdOptions& options,
                                  std::span<const double> given);

// Replaces the atoms that are marked by the signals of largest error, normalised: each by one that
// is no duplicate of those that were put in before it. Signals whose error is rounding replace
// nothing. Returns how many atoms were replaced.
std::size_t replace_atoms(const SignalReader& signals, std::span<const double> errors,
                          const std::vector<bool>& needless, std::span<double> dictionary);

}  // namespace weft::reference
