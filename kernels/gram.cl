// Inner products of two sets of column vectors, in double precision whatever the device offers:
//
//   G(i, j) = sum_p X(p, i) Z(p, j)        X: n x columns_x, Z: n x columns_z
//
// cut into chunks of rows, each of which leaves its partial sums; the host adds them in order:
//
//   partial: [chunk][columns_x][columns_z] of (high, low), G = sum over chunks of high + low
//
// Both sets are addressed as panels of NR columns (offsets in elements):
//
//   X(p, i) = X[x_offset + (i / NR) x_panel + p x_row + i % NR]
//
//   packed panels [ceil(l / NR)][n][NR]:  panel = n NR, row = NR
//   row-major n x ld:                     panel = NR,   row = ld
//
// Rows are padded to a whole panel: columns past the last are read, and their products dropped.
// Work-item (chunk, block of BLOCK columns of Z): 8 columns of floats, 4 of doubles.
//
// ARITHMETIC  32 or 64: of the columns
// DOUBLE  1: products are summed in double; 0 (no fp64; floats only): error-free products and sums of float
//         pairs (Dekker, Knuth; Ogita, Rump & Oishi 2005). Columns are brought near 1 by powers of
//         two, x_scale and z_scale, so that neither products nor their errors leave the range of
//         float; G is then that of the scaled columns.
#include "vector_width.cl"

// SUM_ROWS  rows of a chunk that are summed in double before they are added to the sum so far: errors
//           grow with them and with the number of blocks, not with the rows of a chunk
#ifndef DOUBLE
#define DOUBLE 0
#endif
#ifndef SUM_ROWS
#define SUM_ROWS 512
#endif

#define FOR_ROWS(X) X(0) X(1) X(2) X(3)

#if ARITHMETIC == 64
#define BLOCK 4
typedef double4 sum_t;
#else
#define BLOCK 8
#endif

#if DOUBLE
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double part_t;
typedef double2 pair_t;
#if ARITHMETIC == 64
#define LOAD(p) vload4(0, p)
#define STORE_SUM vstore4
#else
typedef double8 sum_t;
#define LOAD(p) convert_double8(vload8(0, p))
#define STORE_SUM vstore8
#endif
#define DECLARE(r) sum_t s##r = 0, e##r = 0;
#define DECLARE_SCALE(r)
#define ADD(r) s##r = fma((sum_t)((double)x[r]), z, s##r);
// e sums the blocks, s the rows of one.
#define END_BLOCK(r) e##r += s##r; s##r = 0;
#else
typedef float part_t;
typedef float2 pair_t;
typedef float8 sum_t;
#define LOAD(p) (vload8(0, p) * z_scale8)
#define STORE_SUM vstore8
#define DECLARE(r) float8 s##r = 0, e##r = 0;
#define DECLARE_SCALE(r) const float scale##r = x_scale[i + r];
// s + e += x z: the product's error by fma, the sum's by Knuth's two-sum. Contraction would lose it.
#pragma OPENCL FP_CONTRACT OFF
#define ADD(r)                                                        \
  {                                                                   \
    const float8 x8 = x[r] * scale##r;                                \
    const float8 product = x8 * z;                                    \
    const float8 product_error = fma(x8, z, -product);                \
    const float8 sum = s##r + product;                                \
    const float8 part = sum - s##r;                                   \
    e##r += (s##r - (sum - part)) + (product - part) + product_error; \
    s##r = sum;                                                       \
  }
#define END_BLOCK(r)
#endif

void store_row(__global pair_t* out, sum_t high, sum_t low, uint columns) {
  part_t highs[BLOCK], lows[BLOCK];
  STORE_SUM(high, 0, highs);
  STORE_SUM(low, 0, lows);
  for (uint j = 0; j < columns; ++j) out[j] = (pair_t)(highs[j], lows[j]);
}
#define STORE(r) \
  if (i + r < columns_x) store_row(out + (i + r) * columns_z, s##r, e##r, columns);

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void gram(ulong n, ulong chunk_rows, ulong columns_x, ulong columns_z,
                   __global const real* restrict X, ulong x_offset, ulong x_panel, ulong x_row,
                   __global const real* restrict Z, ulong z_offset, ulong z_panel, ulong z_row,
                   __global pair_t* restrict partial
#if !DOUBLE
                   , __global const float* restrict x_scale, __global const float* restrict z_scale
#endif
) {
  const ulong chunk = get_global_id(0);
  const ulong j = get_global_id(1) * BLOCK;
  const ulong begin = chunk * chunk_rows;
  const ulong end = min(begin + chunk_rows, n);
  const uint columns = (uint)min((ulong)BLOCK, columns_z - j);
  __global pair_t* out = partial + chunk * columns_x * columns_z + j;
#if !DOUBLE
  const float8 z_scale8 = vload8(0, z_scale + j);
#endif
  __global const real* z_column = Z + z_offset + (j / NR) * z_panel + j % NR;
  for (ulong i = 0; i < columns_x; i += 4) {
    __global const real* x = X + x_offset + (i / NR) * x_panel + i % NR + begin * x_row;
    __global const real* z_row_begin = z_column + begin * z_row;
    FOR_ROWS(DECLARE)
    FOR_ROWS(DECLARE_SCALE)
    for (ulong block = begin; block < end; block += SUM_ROWS) {
      const ulong block_end = min(block + SUM_ROWS, end);
      for (ulong p = block; p < block_end; ++p, x += x_row, z_row_begin += z_row) {
        const sum_t z = LOAD(z_row_begin);
        FOR_ROWS(ADD)
      }
      FOR_ROWS(END_BLOCK)
    }
    FOR_ROWS(STORE)
  }
}

#if !DOUBLE
// Largest magnitude of each column within a chunk, NaN left out: maxima[chunk][columns].
// Work-item (chunk, block of 8 columns).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void column_maxima(ulong n, ulong chunk_rows, ulong columns, __global const float* restrict X,
                            ulong x_offset, ulong x_panel, ulong x_row, __global float* restrict maxima) {
  const ulong chunk = get_global_id(0);
  const ulong j = get_global_id(1) * 8;
  const ulong begin = chunk * chunk_rows;
  const ulong end = min(begin + chunk_rows, n);
  __global const float* x = X + x_offset + (j / NR) * x_panel + j % NR + begin * x_row;
  float8 most = 0.0f;
  for (ulong p = begin; p < end; ++p, x += x_row) {
    const float8 magnitude = fabs(vload8(0, x));
    most = magnitude > most ? magnitude : most;
  }
  float lanes[8];
  vstore8(most, 0, lanes);
  const uint valid = (uint)min((ulong)8, columns - j);
  for (uint lane = 0; lane < valid; ++lane) maxima[chunk * columns + j + lane] = lanes[lane];
}
#endif
