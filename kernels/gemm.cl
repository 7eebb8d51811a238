// General matrix product with B packed in panels, for CPU devices:
//
//   C = alpha A B + beta C        A: M x K, B: K x N, C: M x N
//
// B is packed in panels of NR columns, zero-padded to a whole panel:
//
//   packed B:  [ceil(N / NR)][K][NR]      B(k, j) = PB[((j / NR) K + k) NR + j % NR]
//
// A and C are addressed by strides, so that row-major, transposed and panelled matrices are served
// alike (offsets in elements):
//
//   A(i, k) = A[a_offset + i a_row + (k / NR) a_panel + (k % NR) a_column]
//   C(i, j) = C[c_offset + i c_row + (j / NR) c_panel + (j % NR)]
//
//   row-major A with leading dimension lda:  a_row = lda, a_column = 1,   a_panel = NR
//   its transpose:                           a_row = 1,   a_column = lda, a_panel = NR lda
//   panels [ceil(K / NR)][R][NR], R >= M:    a_row = NR,  a_column = 1,   a_panel = R NR
//
// One work-item owns a macro-tile of MC x tile_columns of C and loops over micro-tiles of MR x NR, held in
// named vectors; K is cut in blocks of KC, so that a panel's block stays in the first cache
// and float sums stay short.
//
// MC  rows of a macro-tile, a multiple of MR
// KC  depth of a block, a multiple of NR
// A_TRANSPOSED  1 if a_row is 1: the values that a micro-tile takes of a column are neighbours
// A_PANELLED    1 if A is in panels
#include "vector_width.cl"
#include "micro_tile.cl"

#ifndef MC
#define MC 96
#endif
#ifndef KC
#define KC (10 * NR)
#endif
#ifndef A_TRANSPOSED
#define A_TRANSPOSED 0
#endif
#ifndef A_PANELLED
#define A_PANELLED 0
#endif

// Packs a K x N matrix whose element (k, j) is B[b_offset + k b_row + j b_column]; those of a batch
// lie b_batch apart. Work-item (panel, block of `rows` rows, matrix of the batch).
#define STORE_ROW(s) vstore4((real4)(x0.s, x1.s, x2.s, x3.s), 0, to), to += NR;
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_panels(__global const real* restrict B, ulong b_offset, ulong b_row,
                          ulong b_column, ulong b_batch, ulong K, ulong N, ulong rows,
                          __global real* restrict PB) {
  const ulong panel = get_global_id(0);
  const ulong k_begin = get_global_id(1) * rows;
  const ulong k_end = min(k_begin + rows, K);
  const ulong j_begin = panel * NR;
  const uint columns = (uint)min((ulong)NR, N - j_begin);
  __global const real* b = B + b_offset + get_global_id(2) * b_batch + j_begin * b_column;
  __global real* out = PB + (get_global_id(2) * get_global_size(0) + panel) * K * NR;
  ulong k = k_begin;
  if (b_column == 1 && columns == NR) {
    // A whole panel of a row-major matrix: copy vectors.
    for (; k < k_end; ++k) {
      for (int j = 0; j < NR; j += VW) storev(loadv(b + k * b_row + j), out + k * NR + j);
    }
  } else if (b_row == 1) {
    // Of a transposed one: turn blocks of 8 rows and 4 columns.
    for (; k + 8 <= k_end; k += 8) {
      for (uint j = 0; j < NR; j += 4) {
        __global const real* from = b + k + j * b_column;
        __global real* to = out + k * NR + j;
        real8 x0 = 0, x1 = 0, x2 = 0, x3 = 0;
        if (j < columns) x0 = vload8(0, from);
        if (j + 1 < columns) x1 = vload8(0, from + b_column);
        if (j + 2 < columns) x2 = vload8(0, from + 2 * b_column);
        if (j + 3 < columns) x3 = vload8(0, from + 3 * b_column);
        STORE_ROW(s0) STORE_ROW(s1) STORE_ROW(s2) STORE_ROW(s3)
        STORE_ROW(s4) STORE_ROW(s5) STORE_ROW(s6) STORE_ROW(s7)
      }
    }
  }
  for (; k < k_end; ++k) {
    for (uint j = 0; j < columns; ++j) out[k * NR + j] = b[k * b_row + j * b_column];
    for (uint j = columns; j < NR; ++j) out[k * NR + j] = 0;
  }
}

// C = beta C of an M x N matrix; with triangle 1 only columns up to the row, with 2 from it.
// Work-item (row, matrix of the batch).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void scale(ulong N, uint triangle, real beta, __global real* restrict C, ulong c_offset,
                    ulong c_row, ulong c_batch) {
  const ulong i = get_global_id(0);
  __global real* c = C + c_offset + i * c_row + get_global_id(1) * c_batch;
  const ulong last = triangle == 1 ? min(i + 1, N) : N;
  for (ulong j = triangle == 2 ? i : 0; j < last; ++j) c[j] = beta == 0 ? 0 : beta * c[j];
}

#define MULTIPLY_ROW(r) MULTIPLY(r, a##r[k])
#define MULTIPLY_COLUMN(r) MULTIPLY(r, a0[r])
#define PAIR_ROW(r) MULTIPLY_PAIR(r, a##r[k])
#define PAIR_COLUMN(r) MULTIPLY_PAIR(r, a0[r])
#define NARROW_ROW(r) MULTIPLY_NARROW(r, a##r[k])
#define NARROW_COLUMN(r) MULTIPLY_NARROW(r, a0[r])
#define MULTIPLY_EDGE(r) MULTIPLY(r, (r < rows ? a0[r] : 0.0f))

// Work-item (macro-tile of columns, macro-tile of rows, matrix of the batch); tile_columns is a
// multiple of NR, matrices of a batch lie a_batch, b_batch and c_batch apart; PB begins at b_offset.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void gemm(ulong M, ulong N, ulong K, ulong tile_columns, real alpha, __global const real* restrict A,
                   ulong a_offset, ulong a_row, ulong a_column, ulong a_panel,
                   ulong a_batch, __global const real* restrict PB, ulong b_offset, ulong b_batch,
                   real beta,
                   __global real* restrict C, ulong c_offset, ulong c_row, ulong c_panel,
                   ulong c_batch) {
  const ulong a_begin = a_offset + get_global_id(2) * a_batch;
  const ulong b_begin = b_offset + get_global_id(2) * b_batch;
  const ulong c_begin = c_offset + get_global_id(2) * c_batch;
  const ulong j_begin = get_global_id(0) * tile_columns;
  const ulong i_begin = get_global_id(1) * MC;
  const ulong j_end = min(j_begin + tile_columns, N);
  const ulong i_end = min(i_begin + MC, M);
  for (ulong k_begin = 0; k_begin < K; k_begin += KC) {
    const ulong k_end = min(k_begin + KC, K);
    const real block_beta = k_begin == 0 ? beta : 1.0f;
    // A panel stays in the first cache while the rows pass; where all panels of the macro-tile about
    // do, the panels pass, and a row of C is written from one end to the other.
    const bool by_rows = K <= 64;
    ulong i = i_begin, j = j_begin;
    while (i < i_end && j < j_end) {
      const uint columns = (uint)min((ulong)NR, N - j);
      const uint rows = (uint)min((ulong)MR, M - i);
      FOR_ROWS(DECLARE)
      __global const real* b = PB + b_begin + (j / NR) * K * NR + k_begin * NR;
#if A_PANELLED
      // A row of A is whole within a panel only.
      for (ulong panel = k_begin; panel < k_end; panel += NR) {
        const uint depth = (uint)min((ulong)NR, k_end - panel);
        __global const real* a0 = A + a_begin + i * a_row + (panel / NR) * a_panel;
#else
      {
        const uint depth = (uint)(k_end - k_begin);
        __global const real* a0 = A + a_begin + i * a_row + k_begin * a_column;
#endif
#if A_TRANSPOSED
        if (rows < MR) {
          for (uint k = 0; k < depth; ++k, a0 += a_column, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
            FOR_ROWS(MULTIPLY_EDGE)
          }
        } else if (columns <= VW) {
          UNROLL
          for (uint k = 0; k < depth; ++k, a0 += a_column, b += NR) {
            const realv b0 = loadv(b);
            FOR_ROWS(NARROW_COLUMN)
          }
        } else if (columns <= 2 * VW) {
          UNROLL
          for (uint k = 0; k < depth; ++k, a0 += a_column, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW);
            FOR_ROWS(PAIR_COLUMN)
          }
        } else {
          UNROLL
          for (uint k = 0; k < depth; ++k, a0 += a_column, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
            FOR_ROWS(MULTIPLY_COLUMN)
          }
        }
#else
        // Rows past the last repeat it: computed, but not stored.
        __global const real* a1 = a0 + (rows > 1 ? a_row : 0);
        __global const real* a2 = a1 + (rows > 2 ? a_row : 0);
        __global const real* a3 = a2 + (rows > 3 ? a_row : 0);
#if MR == 8
        __global const real* a4 = a3 + (rows > 4 ? a_row : 0);
        __global const real* a5 = a4 + (rows > 5 ? a_row : 0);
        __global const real* a6 = a5 + (rows > 6 ? a_row : 0);
        __global const real* a7 = a6 + (rows > 7 ? a_row : 0);
#endif
        if (columns <= VW) {
          UNROLL
          for (uint k = 0; k < depth; ++k, b += NR) {
            const realv b0 = loadv(b);
            FOR_ROWS(NARROW_ROW)
          }
        } else if (columns <= 2 * VW) {
          UNROLL
          for (uint k = 0; k < depth; ++k, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW);
            FOR_ROWS(PAIR_ROW)
          }
        } else {
          UNROLL
          for (uint k = 0; k < depth; ++k, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
            FOR_ROWS(MULTIPLY_ROW)
          }
        }
#endif
      }
      __global real* c_tile = C + c_begin + i * c_row + (j / NR) * c_panel;
      if (columns == NR) {
        FOR_ROWS(STORE)
      } else {
        FOR_ROWS(STORE_EDGE)
      }
      if (by_rows) {
        j += NR;
        if (j >= j_end) j = j_begin, i += MR;
      } else {
        i += MR;
        if (i >= i_end) i = i_begin, j += NR;
      }
    }
  }
}
