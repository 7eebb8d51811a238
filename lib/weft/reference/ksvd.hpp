// Dictionary learning by K-SVD in double: the truth that host/weft/codecs/ksvd.hpp is checked
// against.
//
//   min over D, X of |Y - X D|^2,  every row of X with at most k entries,  |d_j| = 1
//
// Signals are the rows y_i of Y [signals][dimension], atoms the rows d_j of D [atoms][dimension].
// An iteration updates the atoms one after the other and codes all signals anew. Atom j sees the
// residual of the signals that use it as if it were not there,
//
//   E_j = Y_I - sum over l != j of x_l d_l,   I = {i : x_ij != 0}
//
// and becomes, with its coefficients, the best rank-1 approximation of it (Aharon, Elad &
// Bruckstein 2006, section IV) or one alternating step towards it, d = E_j^T x / |E_j^T x|,
// x = E_j d (Rubinstein, Zibulevsky & Elad 2008, section 4). A signal keeps its support where
// orthogonal matching pursuit finds none that is better (Smith & Elad 2013 reuse coefficients to
// the same end).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace weft {

// exact: the leading singular pair of E_j. approximate: one alternating step.
enum class KsvdUpdate { exact, approximate };
std::string_view name_of(KsvdUpdate update);  // "exact" "approximate"

// Where the dictionary begins. samples: signals spread evenly over all, normalised. random: seeded
// unit vectors. given: the caller's, normalised; zero atoms become random ones.
enum class KsvdStart { samples, random, given };

struct KsvdOptions {
  std::size_t atoms = 256;
  std::size_t sparsity = 10;    // k, most entries of a code
  std::size_t iterations = 30;  // at most; 0 codes with the dictionary that it starts from
  // Stops where an iteration lowers the objective by no more than this part of it and replaced no
  // atom; 0: where it does not lower it.
  double tolerance = 0;
  KsvdUpdate update = KsvdUpdate::approximate;
  KsvdStart start = KsvdStart::samples;
  std::uint64_t seed = 0;
  // Signals that are held at once; 0: all. Otherwise atoms are updated batch by batch, each batch
  // coded just before, and a second pass codes all signals by the dictionary that came out: the
  // objective is measured in both cases.
  std::size_t batch = 0;
};

template <typename Real>
struct KsvdFit {
  std::vector<Real> dictionary;        // [atoms][dimension], unit atoms
  std::vector<std::uint32_t> indices;  // [signals][k]
  std::vector<Real> coefficients;      // [signals][k], 0 from the count on
  std::vector<std::uint32_t> counts;   // [signals]
  double objective = 0;                // |Y - X D|^2 of these, the least of all iterations
  std::vector<double> objectives;      // by the first dictionary, then after each iteration
  std::size_t best = 0;                // whose objective that is
  std::vector<std::size_t> replaced;   // atoms that each iteration replaced
};

namespace reference {

// `given`: [atoms][dimension] for KsvdStart::given. Throws input errors that name the sizes.
KsvdFit<double> ksvd(std::size_t dimension, std::span<const double> signals,
                     const KsvdOptions& options, std::span<const double> given = {});

// One update of all atoms in their order, with the coefficients that use them; supports stay.
// dictionary [atoms][dimension], indices and coefficients [signals][k]. Atoms without use stay.
// The exact update never increases |Y - X D|, nor does the approximate one.
void update_atoms(std::size_t dimension, std::size_t k, KsvdUpdate update,
                  std::span<const double> signals, std::span<const std::uint32_t> indices,
                  std::span<double> coefficients, std::span<double> dictionary);

}  // namespace reference
}  // namespace weft
