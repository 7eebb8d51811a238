// When a truncated SVD is good enough: what the three ways of streamed_svd.hpp share.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "weft/codecs/streamed_svd.hpp"

namespace weft {

// Errors below this part of the norm are measured: a difference of sums of squares in products of
// this arithmetic no longer resolves 1 % of them.
double resolved_error(Arithmetic arithmetic);

// Length below which a direction of X is rounding noise of the products that made it.
double noise_floor(Arithmetic arithmetic, double squares, const SvdTarget& target);

// The largest |X - X_k|^2 that meets all goals.
double wanted_squares(const SvdTarget& target, double squares);

// The smallest k for which rest + sum of values[j]^2, j >= k, is at most `wanted`; values.size() +
// 1 if there is none.
std::size_t smallest_rank(std::span<const double> values, double rest, double wanted);

// Throws the unmet goal: reached with `rank` components, and what forbids more.
[[noreturn]] void fail_unmet(const SvdTarget& target, double squares, double residual_squares,
                             std::size_t rank, std::string_view why);

// Why memory forbids more than k components: how many are needed at least, and with about which
// --memory, which grows with them.
std::string memory_binds(std::size_t k, double needed, std::size_t memory);

}  // namespace weft
