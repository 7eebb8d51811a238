// Directions to light drawn from the code-books of multi-level vector quantisation as they are,
// without a value decoded (Havran et al. 2010, section 5.2).
//
// With u = sin beta, in whose and alpha's steps the grid is (onion_slices.hpp) and d alpha du is
// the solid angle, a slice of the hemisphere is bilinear between the nodes
//
//   F(alpha_i, u_k) = sum_t w_t c_t g(c_P2[t, i] P1[P2[t, i], k])
//
// over the nodes t of view about the query, w_t their weights and c_t = c_P4 c_P3; g(x) = x^gamma
// brings luminance from its encoding towards light, gamma 2.2 where it is encoded, and is taken of
// each factor by itself. So the sums of F along u are sums of the code-vectors' own, and the share
// of the light below u_k in a slice that of their cumulative sums, which are kept: drawing a light
// takes n_alpha sums for the one number, and a search in a few rows of P1 for the other. A share e
// = 0.1 of the density is (cos alpha + 1/10) (cos beta + 1/10), so that it is nowhere 0.
//
// What is stated is this density, exactly; that it follows the light only nearly costs noise alone.
#pragma once

#include <memory>

#include "weft/model/vq.hpp"
#include "weft/scene/light_sampling.hpp"

namespace weft::reference {

// Null for a model that can't be drawn from so: of measured directions, of a single slice or a
// single node of them, without luminance among its channels, or of logarithms. The model must
// outlive it.
std::unique_ptr<LightSampler> vq_light_sampler(const VqModel& model);

}  // namespace weft::reference
