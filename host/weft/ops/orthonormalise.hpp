// Orthonormal bases on the device, from inner products in double.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"

namespace weft::ops {

// Replaces the `count` columns of Y, packed panels [ceil(count / NR)][n][NR], by an orthonormal
// basis of their span, sorted by descending extent (the left singular vectors of Y scaled to unit
// columns), and returns its dimension r; the columns after the r-th are zero.
//
//   G = D Y^T Y D,  D = diag(1 / |y_j|)      G = V diag(lambda) V^T
//   Y <- Y D V diag(lambda)^(-1/2)
//
// and once more, since this leaves the error of float times the condition number; the second time
// with V diag(lambda)^(-1/2) V^T, which keeps the order. Directions
// with lambda below (count 2^-23)^2 of the largest are dropped: float columns do not hold them; of
// columns of doubles those below count 2^-48 of it, which G does not hold.
// Zero columns are allowed, and so are columns of any magnitude; NaN or an infinity is a run-time
// error. `scratch` is as large as Y. Waits for the device.
//
// With `least`, columns that were orthonormal before something was taken out of them are not scaled
// to unit length first, and directions of which less than this length is left are dropped: what is
// left of them is rounding.
std::size_t orthonormalise(Device& device, std::size_t n, std::size_t count, Buffer& Y,
                           Buffer& scratch, Arithmetic arithmetic = Arithmetic::f32,
                           double least = 0);

// Y <- Y - Q (Q^T Y): removes from Y (packed, count columns) its part in the span of the
// orthonormal columns of Q (packed, q_count columns). The coefficients are summed in double.
void project_out(Device& device, std::size_t n, const Buffer& Q, std::size_t q_count, Buffer& Y,
                 std::size_t count, Arithmetic arithmetic = Arithmetic::f32);

}  // namespace weft::ops
