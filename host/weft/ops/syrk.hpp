// Products of a matrix with its own transpose (Gram matrices) on the device: kernels/syrk.cl.
#pragma once

#include <cstddef>

#include "weft/device/device.hpp"
#include "weft/ops/arithmetic.hpp"
#include "weft/ops/gemm.hpp"

namespace weft::ops {

// C = alpha X^T X + beta C of a K x m matrix X in packed panels [ceil(m / NR)][K][NR], padded with
// zero; NR is panel_width(device, arithmetic). C is m x m, row-major; its lower triangle, j <= i,
// is valid, what is above is unspecified. Where beta is 0, C is not read. K is at least 1.
//
// Sums are blocked: |error(i, j)| <= gamma(syrk_terms(K)) (|alpha| sum |X(k, i) X(k, j)| +
// |beta C(i, j)|) with gamma(n) = n u / (1 - n u) and u the unit roundoff.
void syrk_packed(Device& device, std::size_t m, std::size_t K, double alpha, const Buffer& packed,
                 double beta, Buffer& C, std::size_t leading,
                 Arithmetic arithmetic = Arithmetic::f32);

// The same into a part of C, in other triangles. Written::blocks is the form above; with the others
// only C(i, j), j <= i or j >= i, is read and written.
enum class Written { blocks, lower, upper };
void syrk_packed(Device& device, std::size_t m, std::size_t K, double alpha, const Buffer& packed,
                 double beta, const Result& C, Written written, Arithmetic arithmetic);

// C = alpha (sum of slices) + beta C in a triangle, lower or upper, of m x m. The slices hold the
// lower triangle of their sums: [slice][m][row].
void add_slices(Device& device, std::size_t m, std::size_t slices, const Buffer& partial,
                std::size_t row, double alpha, double beta, const Result& C, Written written,
                Arithmetic arithmetic);

// Bytes of the partial sums that syrk_packed() holds on the device.
std::size_t syrk_bytes(const Device& device, std::size_t m, std::size_t K,
                       Arithmetic arithmetic = Arithmetic::f32);

// Roundings that a product can go through on its way into C.
std::size_t syrk_terms(const Device& device, std::size_t m, std::size_t K,
                       Arithmetic arithmetic = Arithmetic::f32);

}  // namespace weft::ops
