// The clustering stage of clustered tensor approximation (Tsai & Shih 2012, section 4.2): which
// clusters a slice is a mixture of, and by which coefficients. With B the rows Z_c x_n U_n,c, n !=
// m, of all clusters, it needs products of slices with them alone: a = A_i B^T and G = B B^T. The
// terms of the greedy search (9), (13) are, by (7), (14) and (19),
//
//   ufm(A^(c)) V_c^T  = a_c G_cc^-1/2        ufm(Z_j^(c) x_m u) V_c^T = u G_jc G_cc^-1/2
//
// and those of optimal projection (17), (18) are blocks of G and a themselves: R_m rows for each
// cluster take the place of its R_1 R_2 ... R_N-dimensional space.
#pragma once

#include <cstddef>
#include <map>
#include <span>
#include <vector>

#include "weft/btf/view_grid.hpp"
#include "weft/reference/kcta_mixing.hpp"

namespace weft {

class SliceMixer {
 public:
  // G: [C R][C R]; it must outlive the mixer.
  SliceMixer(std::size_t clusters, std::size_t mixtures, std::span<const double> gram);

  std::size_t columns() const { return clusters_ * rank_; }
  // Appends the clusters of a slice, ascending, and its coefficients for them, [K][R], from its
  // products a; returns what they explain of the slice, squared.
  double mix(std::span<const double> a, reference::KctaMixing& mixing);

 private:
  double explained_by(std::size_t cluster, std::span<const double> a) const;
  void project(std::span<const double> a);

  std::size_t clusters_, mixtures_, rank_;
  std::span<const double> gram_;
  std::vector<std::vector<double>> roots_;  // G_cc^-1/2
  // of the slice in hand: its clusters, their rows of B, its coefficients for those
  std::vector<std::size_t> chosen_;
  std::vector<std::size_t> rows_;
  std::vector<double> u_;
  // pseudoinverses of (17) for clusters that were chosen in this order
  std::map<std::vector<std::size_t>, std::vector<double>> inverses_;
};

// All slices, from A B^T [slices][C R] and their squared norms.
reference::KctaMixing mix_by_products(std::size_t clusters, std::size_t mixtures,
                                      std::span<const double> products,
                                      std::span<const double> gram,
                                      std::span<const double> squares);

// Views of a grid, each what is interpolated of the slices (section 6.3.2); errors are left empty.
reference::KctaMixing mix_between(const ViewResampling& views, std::size_t clusters,
                                  std::size_t mixtures, std::span<const double> products,
                                  std::span<const double> gram);

}  // namespace weft
