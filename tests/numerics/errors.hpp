// One factorisation of one matrix by one path, and how far it is from the truth.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "numerics/matrices.hpp"
#include "numerics/reference_svd.hpp"
#include "weft/codecs/svd_options.hpp"
#include "weft/device/device.hpp"

namespace weft::numerics {

// 2^exponent X ~ XV V^T with the first `rank` components; what a path gives up as rounding noise is
// not among them.
struct Computed {
  int exponent = 0;
  std::size_t rank = 0;
  std::vector<double> values;  // rank
  std::vector<double> V;       // columns x rank
  std::vector<double> XV;      // rows x rank
};

// Up to `rank` components, by the path.
Computed factorise(Device& device, const Matrix& matrix, std::size_t rank, SvdMethod method,
                   Arithmetic arithmetic);

// Of the components that were asked for; a singular value that was given up counts as 0.
struct Errors {
  std::size_t rank = 0;  // that were found
  double value = 0;      // largest |s_j - sigma_j| / sigma_1
  double relative = 0;   // largest |s_j - sigma_j| / sigma_j of the sigma_j that are not zero
  double resolved = 0;   // smallest sigma_j / sigma_1 such that it and all before are within 10 %
  double subspace = 0;   // sine of the largest angle between the leading right subspaces
  double reconstruction = 0;  // |X - XV V^T| / |X|
};

Errors compare(const Case& what, const Matrix& matrix, const ReferenceSvd& truth,
               const Computed& computed);

}  // namespace weft::numerics
