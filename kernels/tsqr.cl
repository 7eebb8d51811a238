// Householder reduction of blocks of rows onto upper triangles, for CPU devices (one work-item per
// chain; other devices run it too, slowly):
//
//   [ R ]       [ R' ]      R: m x m upper triangular, B: rows x m
//   [ B ]  =  Q [ 0  ]
//
// by panels of NR columns: factor_panel reduces one panel, apply_panel applies its reflectors,
// as I - V T^T V^T with V = [unit rows; Vb] (Schreiber & Van Loan 1989), to a panel to the right.
// Several pairs (R, B), the chains, are reduced in one launch. Vb replaces the panel in B.
//
//   B, a block:    [panels][capacity][NR]        chain c holds rows c capacity .. (c + 1) capacity
//   R, and B where `triangular` is 1: panel q holds its first (q + 1) NR rows, zero below the diagonal
//
//     q = 0      1        2
//   +-------+--------+--------+
//   | NR^2  |        |        |
//   +-------+ 2 NR^2 |        |      panel q begins at NR^2 q (q + 1) / 2
//           +--------+ 3 NR^2 |
//                    +--------+
//
//   T: [chains][NR][NR], row j is column j of the upper triangular factor T
//
// Column j of a panel, x = [alpha; b]: with beta = -sign(alpha) |x|,
//
//   v = [1; b / (alpha - beta)],  tau = (beta - alpha) / beta,  (I - tau v v^T) x = [beta; 0]
//
// Squares and inner products are those of `scale` x, scale a power of two that brings |x| near 1:
// any magnitude is handled alike, and nothing but x is squared. A zero b leaves its column as it is.
//
// SUM_ROWS  rows whose products are summed before they are added to the sum so far: sums of floats
//           stay short; a multiple of 2
#include "vector_width.cl"

#include "micro_tile.cl"

#ifndef SUM_ROWS
#define SUM_ROWS 128
#endif

// Powers of two that a real holds, with their inverses at least as subnormals.
#if ARITHMETIC == 64
#define LEAST_EXPONENT -1022
#define MOST_EXPONENT 1023
#else
#define LEAST_EXPONENT -126
#define MOST_EXPONENT 127
#endif

// Elements before panel q of a triangle.
ulong triangle_panel(ulong q) { return NR * NR * (q * (q + 1) / 2); }

// Rows of a chain's block among all rows.
ulong chain_rows(ulong rows, ulong capacity, ulong chain) {
  const ulong before = chain * capacity;
  return rows > before ? min(rows - before, capacity) : 0;
}

// Makes triangles zero. Work-item (NR rows of a panel).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void clear_triangle(__global real* restrict R, ulong offset) {
  __global real* out = R + offset + get_global_id(0) * NR * NR;
  for (uint i = 0; i < NR * NR; i += VW) storev((realv)(0), out + i);
}

// Copies rows of packed panels into the blocks: row first + i of [panels][packed_rows][NR] becomes row
// filled + i of the chains' rows, i < count. Columns from m on are zero in the blocks, and so are the
// rows up to the next multiple of MR (capacity is one), so that whole groups of rows can be computed with. Work-item (panel, chain).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void append_rows(ulong m, __global const real* restrict packed, ulong packed_rows, ulong first,
                          ulong count, ulong filled, __global real* restrict B, ulong b_step,
                          ulong capacity) {
  const ulong panel = get_global_id(0);
  const ulong chain = get_global_id(1);
  const ulong begin = max(filled, chain * capacity);
  const ulong end = min(filled + count, (chain + 1) * capacity);
  if (begin >= end) return;
  const uint columns = (uint)min((ulong)NR, m - panel * NR);
  __global real* block = B + chain * b_step + panel * capacity * NR;
  __global const real* in = packed + (panel * packed_rows + first + (begin - filled)) * NR;
  __global real* out = block + (begin - chain * capacity) * NR;
  for (ulong row = begin; row < end; ++row, in += NR, out += NR) {
    if (columns == NR) {
      for (uint j = 0; j < NR; j += VW) storev(loadv(in + j), out + j);
    } else {
      for (uint j = 0; j < NR; ++j) out[j] = j < columns ? in[j] : 0;
    }
  }
  for (ulong row = end - chain * capacity; row % MR != 0; ++row, out += NR) {
    for (uint j = 0; j < NR; j += VW) storev((realv)(0), out + j);
  }
}

// Column j of a panel: inner products of scale lift b(:, j) with every column, and the sum of the
// squares of scale lift b(:, j), which is returned. For the columns whose scale was not foreseen.
WIDE_VECTORS real column_products(__global const real* b, ulong rows, uint j, real scale, real lift, real* products) {
  real squares = 0;
  realv x = 0, y = 0, z = 0;
  for (ulong begin = 0; begin < rows; begin += SUM_ROWS) {
    const ulong end = min(begin + SUM_ROWS, rows);
    realv x0 = 0, y0 = 0, z0 = 0;
    real square = 0;
    for (ulong r = begin; r < end; ++r) {
      __global const real* row = b + r * NR;
      const real a = row[j] * scale * lift;
      square = fma(a, a, square);
      x0 = fma((realv)(a), loadv(row), x0);
      y0 = fma((realv)(a), loadv(row + VW), y0);
      z0 = fma((realv)(a), loadv(row + 2 * VW), z0);
    }
    squares += square;
    x += x0;
    y += y0;
    z += z0;
  }
  storev(x, products);
  storev(y, products + VW);
  storev(z, products + 2 * VW);
  return squares;
}

real largest_magnitude(__global const real* b, ulong rows, uint j) {
  real largest = 0;
  for (ulong r = 0; r < rows; ++r) {
    const real magnitude = fabs(b[r * NR + j]);
    largest = magnitude > largest ? magnitude : largest;
  }
  return largest;
}

// The power of two that brings a magnitude into [1, 2), as far as reals go.
real scale_of(real magnitude) {
  if (!(magnitude > 0)) return 1;
  return ldexp((real)1, clamp(-ilogb(magnitude), LEAST_EXPONENT, MOST_EXPONENT));
}

// Applies reflector j to the rows of its panel, and forms the inner products of column j + 1, times
// next_scale, with every column, in the same pass:
//
//   v = b(:, j) scale inverse      b <- b - v w^T, w(k) = 0 for k <= j      b(:, j) <- v
//
// KEEP is 0 in lane j and 1 elsewhere, and w(j) is -1, so that the vector which holds lane j has v there.
#define LOAD_ROW(p)                                                                           \
  const real v##p = row##p[j] * scale * inverse;                                              \
  const real a##p = fma(-v##p, w_next, row##p[next]) * next_scale;
#define KEEP_V(vector, p, at) vector = loadv(row##p + at);
#define REFLECT(vector, p, at, wv)                                       \
  vector = fma((realv)(-v##p), wv, loadv(row##p + at));                  \
  storev(vector, row##p + at);
#define REFLECT_J(vector, p, at, wv)                                     \
  vector = fma((realv)(-v##p), wv, loadv(row##p + at) * keep);           \
  storev(vector, row##p + at);
#define ADD_PRODUCTS(p)                     \
  x##p = fma((realv)(a##p), ux, x##p);      \
  y##p = fma((realv)(a##p), uy, y##p);      \
  z##p = fma((realv)(a##p), uz, z##p);

// One row, for j in the first, the second and the third vector of a panel.
#define ROW_0(p)                                                                          \
  {                                                                                       \
    LOAD_ROW(p)                                                                           \
    realv ux, uy, uz;                                                                     \
    REFLECT_J(ux, p, 0, wx) REFLECT(uy, p, VW, wy) REFLECT(uz, p, 2 * VW, wz)             \
    ADD_PRODUCTS(p)                                                                       \
  }
#define ROW_1(p)                                                                          \
  {                                                                                       \
    LOAD_ROW(p)                                                                           \
    realv ux, uy, uz;                                                                     \
    KEEP_V(ux, p, 0) REFLECT_J(uy, p, VW, wy) REFLECT(uz, p, 2 * VW, wz)                  \
    ADD_PRODUCTS(p)                                                                       \
  }
#define ROW_2(p)                                                                          \
  {                                                                                       \
    LOAD_ROW(p)                                                                           \
    realv ux, uy, uz;                                                                     \
    KEEP_V(ux, p, 0) KEEP_V(uy, p, VW) REFLECT_J(uz, p, 2 * VW, wz)                       \
    ADD_PRODUCTS(p)                                                                       \
  }

#define REFLECT_ROWS(ROW)                                                    \
  for (ulong begin = 0; begin < rows; begin += SUM_ROWS) {                   \
    const ulong end = min(begin + SUM_ROWS, rows);                           \
    realv x0 = 0, y0 = 0, z0 = 0, x1 = 0, y1 = 0, z1 = 0;                    \
    ulong r = begin;                                                         \
    for (; r + 1 < end; r += 2) {                                            \
      __global real* row0 = b + r * NR;                                      \
      __global real* row1 = row0 + NR;                                       \
      ROW(0)                                                                 \
      ROW(1)                                                                 \
    }                                                                        \
    if (r < end) {                                                           \
      __global real* row0 = b + r * NR;                                      \
      ROW(0)                                                                 \
    }                                                                        \
    x += x0 + x1;                                                            \
    y += y0 + y1;                                                            \
    z += z0 + z1;                                                            \
  }

WIDE_VECTORS void reflect_panel(__global real* b, ulong rows, uint j, real scale, real inverse, real* w,
                   real next_scale, real* products) {
  const uint next = min(j + 1, (uint)(NR - 1));
  const real w_next = w[next];
  real lanes[VW];
  for (uint lane = 0; lane < VW; ++lane) lanes[lane] = lane == j % VW ? 0 : 1;
  const realv keep = loadv(lanes);
  w[j] = -1;
  const realv wx = loadv(w), wy = loadv(w + VW), wz = loadv(w + 2 * VW);
  realv x = 0, y = 0, z = 0;
  if (j < VW) {
    REFLECT_ROWS(ROW_0)
  } else if (j < 2 * VW) {
    REFLECT_ROWS(ROW_1)
  } else {
    REFLECT_ROWS(ROW_2)
  }
  storev(x, products);
  storev(y, products + VW);
  storev(z, products + 2 * VW);
}

// Reduces a panel of every chain; rows: of all chains' blocks together. Work-item (chain).
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void factor_panel(ulong panel, uint triangular, ulong rows_of_all, ulong capacity,
                           __global real* R, ulong r_offset, ulong r_step, __global real* B,
                           ulong b_offset, ulong b_step, __global real* restrict T, ulong m) {
  const ulong chain = get_global_id(0);
  const ulong rows = triangular ? (panel + 1) * NR : chain_rows(rows_of_all, capacity, chain);
  __global real* top = R + r_offset + chain * r_step + triangle_panel(panel) + panel * NR * NR;
  __global real* b = B + b_offset + chain * b_step +
                     (triangular ? triangle_panel(panel) : panel * capacity * NR);
  __global real* t = T + chain * NR * NR;
  real products[NR];
  real w[NR];
  real scale = 1;
  // no reflectors for the columns that fill the last panel, which is never applied
  const uint columns = (uint)min((ulong)NR, m - panel * NR);
  for (uint j = 0; j < columns; ++j) {
    __global real* top_row = top + j * NR;
    const real alpha = top_row[j];
    // The scale that was foreseen from the column before serves if |x| is near 1 with it. For subnormal
    // columns one power of two does not reach: lift is the rest.
    real lift = 1;
    real scaled_alpha = alpha * scale;
    real tail = j == 0 ? 0 : products[j] * scale;
    const real square = fma(scaled_alpha, scaled_alpha, tail);
    const bool foreseen = scale >= (real)0x1p-60f && scale <= (real)0x1p60f &&
                          square >= (real)0x1p-20f && square <= 4;
    if (!foreseen || j == 0) {
      const real largest = largest_magnitude(b, rows, j);
      const real most = largest > fabs(alpha) ? largest : fabs(alpha);
      scale = scale_of(most);
      lift = scale_of(most * scale);
      scaled_alpha = alpha * scale * lift;
      tail = column_products(b, rows, j, scale, lift, products);
    }

    // the reflector
    real tau = 0, inverse = 0, next_scale = scale;
    if (tail != 0) {
      const real norm = sqrt(fma(scaled_alpha, scaled_alpha, tail));
      const real beta = scaled_alpha < 0 ? norm : -norm;
      tau = (beta - scaled_alpha) / beta;
      inverse = 1 / (scaled_alpha - beta);
      top_row[j] = beta / lift / scale;
      next_scale = scale_of(norm / lift / scale);
    }

    // column j of T: -tau T (V^T v), of which the unit rows contribute nothing
    __global real* t_row = t + j * NR;
    realv tx = 0, ty = 0, tz = 0;
    for (uint l = 0; l < j; ++l) {
      const realv g = -tau * (products[l] * inverse);
      tx = fma(g, loadv(t + l * NR), tx);
      ty = fma(g, loadv(t + l * NR + VW), ty);
      tz = fma(g, loadv(t + l * NR + 2 * VW), tz);
    }
    storev(tx, t_row);
    storev(ty, t_row + VW);
    storev(tz, t_row + 2 * VW);
    t_row[j] = tau;

    // w = tau v^T [R; B], and the row of R
    for (uint k = 0; k < NR; ++k) {
      w[k] = 0;
      if (k <= j) continue;
      w[k] = tau * fma(inverse, products[k], top_row[k]);
      top_row[k] -= w[k];
    }
    reflect_panel(b, rows, j, scale, lift * inverse, w, next_scale, products);
    scale = next_scale;
  }
}

#define ADD_W(i) MULTIPLY(i, v[i])
#define STORE_W(i)                                                         \
  {                                                                        \
    real* sum = W + (column + i) * NR;                                     \
    storev(x##i + loadv(sum), sum);                                        \
    storev(y##i + loadv(sum + VW), sum + VW);                              \
    storev(z##i + loadv(sum + 2 * VW), sum + 2 * VW);                      \
  }
#define LOAD_C(i)                                                          \
  realv x##i = loadv(c + i * NR), y##i = loadv(c + i * NR + VW),           \
        z##i = loadv(c + i * NR + 2 * VW);
#define ADD_C(i) MULTIPLY(i, v[i * NR + k])
#define STORE_C(i)                          \
  storev(x##i, c + i * NR);                 \
  storev(y##i, c + i * NR + VW);            \
  storev(z##i, c + i * NR + 2 * VW);

// Applies the reflectors of a panel to a later one: W = T^T (R_top + Vb^T C), R_top -= W, C -= Vb W.
// Rows of a block are padded with zero to a multiple of MR. Work-item (later panel less panel + 1,
// chain).
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void apply_panel(ulong panel, uint triangular, ulong rows_of_all, ulong capacity,
                          __global real* R, ulong r_offset, ulong r_step, __global real* B,
                          ulong b_offset, ulong b_step, __global const real* restrict T) {
  const ulong later = panel + 1 + get_global_id(0);
  const ulong chain = get_global_id(1);
  const ulong rows = triangular ? (panel + 1) * NR : chain_rows(rows_of_all, capacity, chain);
  __global real* top = R + r_offset + chain * r_step + triangle_panel(later) + panel * NR * NR;
  __global real* blocks = B + b_offset + chain * b_step;
  __global const real* V = blocks + (triangular ? triangle_panel(panel) : panel * capacity * NR);
  __global real* C = blocks + (triangular ? triangle_panel(later) : later * capacity * NR);
  __global const real* t = T + chain * NR * NR;

  // R_top + Vb^T C, by runs of rows that stay in the first cache
  real W[NR * NR];
  for (uint i = 0; i < NR * NR; i += VW) storev(loadv(top + i), W + i);
  for (ulong begin = 0; begin < rows; begin += SUM_ROWS) {
    const ulong end = min(begin + SUM_ROWS, rows);
    for (uint column = 0; column < NR; column += MR) {
      __global const real* v = V + begin * NR + column;
      __global const real* c = C + begin * NR;
      FOR_ROWS(DECLARE)
      for (ulong r = begin; r < end; ++r, v += NR, c += NR) {
        const realv b0 = loadv(c), b1 = loadv(c + VW), b2 = loadv(c + 2 * VW);
        FOR_ROWS(ADD_W)
      }
      FOR_ROWS(STORE_W)
    }
  }

  // T^T W, from the last row up, and the rows of R; W is kept negative
  for (int i = NR - 1; i >= 0; --i) {
    realv x = 0, y = 0, z = 0;
    for (int l = 0; l <= i; ++l) {
      const realv a = t[i * NR + l];
      x = fma(a, loadv(W + l * NR), x);
      y = fma(a, loadv(W + l * NR + VW), y);
      z = fma(a, loadv(W + l * NR + 2 * VW), z);
    }
    __global real* row = top + i * NR;
    storev(loadv(row) - x, row);
    storev(loadv(row + VW) - y, row + VW);
    storev(loadv(row + 2 * VW) - z, row + 2 * VW);
    storev(-x, W + i * NR);
    storev(-y, W + i * NR + VW);
    storev(-z, W + i * NR + 2 * VW);
  }

  // C -= Vb W
  for (ulong r = 0; r < rows; r += MR) {
    __global const real* v = V + r * NR;
    __global real* c = C + r * NR;
    FOR_ROWS(LOAD_C)
    for (uint k = 0; k < NR; ++k) {
      const realv b0 = loadv(W + k * NR), b1 = loadv(W + k * NR + VW), b2 = loadv(W + k * NR + 2 * VW);
      FOR_ROWS(ADD_C)
    }
    FOR_ROWS(STORE_C)
  }
}
