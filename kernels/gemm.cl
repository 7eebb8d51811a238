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
// PACK_ROWS  rows that one work-item of pack_panels packs
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
#ifndef PACK_ROWS
#define PACK_ROWS 64
#endif

// Packs a K x N matrix whose element (k, j) is B[b_offset + k b_row + j b_column].
// Work-item (panel, block of PACK_ROWS rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_panels(__global const real* restrict B, ulong b_offset, ulong b_row,
                          ulong b_column, ulong K, ulong N, __global real* restrict PB) {
  const ulong panel = get_global_id(0);
  const ulong k_begin = get_global_id(1) * PACK_ROWS;
  const ulong k_end = min(k_begin + PACK_ROWS, K);
  const ulong j_begin = panel * NR;
  const ulong columns = min((ulong)NR, N - j_begin);
  __global const real* b = B + b_offset + j_begin * b_column;
  __global real* out = PB + panel * K * NR;
  // A whole panel of a row-major matrix: copy vectors.
  if (b_column == 1 && columns == NR) {
    for (ulong k = k_begin; k < k_end; ++k) {
      for (int j = 0; j < NR; j += VW) storev(loadv(b + k * b_row + j), out + k * NR + j);
    }
    return;
  }
  for (ulong k = k_begin; k < k_end; ++k) {
    for (ulong j = 0; j < columns; ++j) out[k * NR + j] = b[k * b_row + j * b_column];
    for (ulong j = columns; j < NR; ++j) out[k * NR + j] = 0.0f;
  }
}

#define MULTIPLY_ROW(r) MULTIPLY(r, a##r[k])
#define MULTIPLY_COLUMN(r) MULTIPLY(r, a0[r])
#define MULTIPLY_EDGE(r) MULTIPLY(r, (r < rows ? a0[r] : 0.0f))

// Work-item (macro-tile of columns, macro-tile of rows); tile_columns is a multiple of NR.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void gemm(ulong M, ulong N, ulong K, ulong tile_columns, real alpha, __global const real* restrict A,
                   ulong a_offset, ulong a_row, ulong a_column, ulong a_panel,
                   __global const real* restrict PB, real beta, __global real* restrict C,
                   ulong c_offset, ulong c_row, ulong c_panel) {
  const ulong j_begin = get_global_id(0) * tile_columns;
  const ulong i_begin = get_global_id(1) * MC;
  const ulong j_end = min(j_begin + tile_columns, N);
  const ulong i_end = min(i_begin + MC, M);
  for (ulong k_begin = 0; k_begin < K; k_begin += KC) {
    const ulong k_end = min(k_begin + KC, K);
    const real block_beta = k_begin == 0 ? beta : 1.0f;
    for (ulong j = j_begin; j < j_end; j += NR) {
      const uint columns = (uint)min((ulong)NR, N - j);
      for (ulong i = i_begin; i < i_end; i += MR) {
        const uint rows = (uint)min((ulong)MR, M - i);
        FOR_ROWS(DECLARE)
        __global const real* b = PB + (j / NR) * K * NR + k_begin * NR;
#if A_PANELLED
        // A row of A is whole within a panel only.
        for (ulong panel = k_begin; panel < k_end; panel += NR) {
          const uint depth = (uint)min((ulong)NR, k_end - panel);
          __global const real* a0 = A + a_offset + i * a_row + (panel / NR) * a_panel;
#else
        {
          const uint depth = (uint)(k_end - k_begin);
          __global const real* a0 = A + a_offset + i * a_row + k_begin * a_column;
#endif
#if A_TRANSPOSED
          if (rows < MR) {
            for (uint k = 0; k < depth; ++k, a0 += a_column, b += NR) {
              const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
              FOR_ROWS(MULTIPLY_EDGE)
            }
          } else {
#pragma unroll 4
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
#pragma unroll 4
          for (uint k = 0; k < depth; ++k, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
            FOR_ROWS(MULTIPLY_ROW)
          }
#endif
        }
        __global real* c_tile = C + c_offset + i * c_row + (j / NR) * c_panel;
        if (columns == NR) {
          FOR_ROWS(STORE)
        } else {
          FOR_ROWS(STORE_EDGE)
        }
      }
    }
  }
}
