// What a path promises for one matrix, from its arithmetic: the bounds that the suite asserts and
// that docs/numerics.md explains.
#pragma once

#include "numerics/errors.hpp"

namespace weft::numerics {

// u of an arithmetic: half of the distance from 1 to the next number.
double roundoff(Arithmetic arithmetic);

struct Bounds {
  double value = 0;           // as in Errors
  double resolved = 0;        // singular values above this part of the first are within 10 %
  double subspace = 0;        // of the case's leading subspace
  double reconstruction = 0;  // as in Errors
};

Bounds bounds_of(const Case& what, const Matrix& matrix, const ReferenceSvd& truth,
                 SvdMethod method, Arithmetic arithmetic);

}  // namespace weft::numerics
