// Sparse coding by orthogonal matching pursuit (OMP), in Eigen and double: the truth that
// host/weft/ops/batch_omp.hpp is checked against.
//
// A signal y is approximated by few atoms d_n of a dictionary, y ~ sum_j x_j d_(n_j): of all atoms,
// the one of the largest |d_n . r| / |d_n| with what is left, r, is chosen (the lowest index of
// several), x becomes the least squares solution on the atoms chosen so far, r = y - D x, and so on
// (Pati, Rezaiifar, Krishnaprasad 1993; section 3.1 of Aharon, Elad, Bruckstein 2006).
//
// Signals and atoms are rows: Y is [signals][dimension], D is [atoms][dimension].
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace weft {

// Where the pursuit of a signal ends: with as many atoms, or before, as soon as |y - D x| is at
// most `residual`, in the unit of the signals. It also ends where no atom can improve the
// approximation; see PursuitLimits.
struct OmpTarget {
  std::size_t sparsity = 0;  // k, most atoms of a signal
  double residual = 0;       // |y - D x| to reach; 0: k atoms, whatever the residual
};

// What no pursuit goes beyond, on devices and in the reference alike, so that float arithmetic can
// follow it and coefficients stay bounded.
struct PursuitLimits {
  // It ends where |d_n . r| / |d_n| <= smallest |y| for all atoms: what is left is rounding, or out
  // of the dictionary's reach.
  static constexpr double smallest_correlation = 0x1p-19;
  // An atom at most this far from the span of those chosen, as a part of its norm, is not chosen.
  static constexpr double least_distance = 0x1p-12;
  // It ends after as many such atoms in one step.
  static constexpr std::size_t most_dependent = 256;
};

}  // namespace weft

namespace weft::reference {

// Codes of fixed length k, [signals][k]. The first counts[s] of a signal are its atoms in the order
// in which they were chosen; the others have coefficient 0 and the lowest indices that were not
// chosen, as long as there are any, then index 0.
struct SparseCodes {
  std::size_t sparsity = 0;            // k
  std::vector<std::uint32_t> indices;  // [signals][k]
  std::vector<double> coefficients;    // [signals][k], of the atoms as given
  std::vector<std::uint32_t> counts;   // [signals]
  std::vector<double> residuals;       // [signals], |y - D x|
};

// Codes of all rows of Y. Atoms of any norm; zero atoms, and those with a NaN or infinity, are
// never chosen. A signal with a NaN or infinity has no coefficients, and NaN as its residual.
SparseCodes batch_omp(std::size_t atoms, std::size_t dimension, std::span<const double> D,
                      std::span<const double> Y, const OmpTarget& target);

}  // namespace weft::reference
