// Directions to light drawn from the code-books of multi-level vector quantisation as they are,
// without a value decoded (Havran et al. 2010, section 5.2).
//
// With u = sin beta, in whose and alpha's steps the grid is (onion_slices.hpp) and d alpha du is
// the solid angle, a slice of the hemisphere is bilinear between the nodes
//
//   F(alpha_i, u_k) = sum_t w_t c_t g(c_P2[t, i] P1[P2[t, i], k])
//
// over the nodes t of view about the query, w_t their weights and c_t = g(c_P4 c_P3); g(x) =
// x^gamma brings luminance from its encoding towards light, gamma 2.2 where it is encoded, and is
// taken of each factor by itself. So the sums of F along u are sums of the code-vectors' own, and
// the share of the light below u_k in a slice that of their cumulative sums. Both are kept in
// tables, those of P1 along u and those of P2 along alpha:
//
//   [ P1 values | P1 sums ]   rows of 2 n_beta, at u_k and of what lies below it
//   [ P2 values | P2 sums ]   rows of 2 n_alpha, of the integrals of slices along u
//
// Drawing a light sums 5 rows of n_alpha for the one number and 9 of n_beta for the other, and
// takes two arc tangents, a sine and a cosine. A share e = 0.1 of the density is (cos alpha + 1/10)
// (cos beta + 1/10), so that it is nowhere 0.
//
// What is stated is this density, exactly; that it follows the light only nearly costs noise alone.
// Tables are float: what is below 1e-38 of the largest value of a code-book counts as black.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/model/vq.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft::reference {

// Null for a model that can't be drawn from so: of measured directions, of a single slice or a
// single node of them, without luminance among its channels, or of logarithms. The model must
// outlive it. Large batches are shared by `threads`, 0: one per core; lights do not depend on it.
std::unique_ptr<LightSampler> vq_light_sampler(const VqModel& model, std::size_t threads = 0);

}  // namespace weft::reference
