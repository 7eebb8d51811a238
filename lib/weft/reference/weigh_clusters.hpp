// The codec `lpca` of texels with weights: what it fits are s_p T_p, whose clusters do not have the
// mean of one texel in common but its multiples s_p m.
#pragma once

#include <cstddef>
#include <span>

#include "weft/model/lpca.hpp"

namespace weft::reference {

// From clusters that were fitted to x_p = s_p T_p with a component more than wanted,
//
//   x_p ~ mu_g + sum_j a[p, j] b[g, j]        mu_g, b[g, j] span a space M_g
//
// to those of the affine subspaces in M_g that lose least, at most `rank` dimensions each:
//
//   x_p ~ s_p m_g + sum_{j < rank} A[p, j] B[g, j]
//
// m_g is the mean of the cluster's texels with the weights s_p^2, and A B their principal
// components without it. The model's means are the m_g then, and its coefficients still those of
// x_p.
void weigh_clusters(LpcaModel& model, std::span<const float> texel_scale, std::size_t rank);

}  // namespace weft::reference
