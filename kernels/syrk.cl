// Product of a matrix with its own transpose, for CPU devices:
//
//   C(i, j) = alpha sum_k X(k, i) X(k, j) + beta C(i, j),   j <= i or j >= i        X: K x m
//
// X is packed in panels of NR columns, zero-padded to a whole panel, and read for both sides:
//
//   packed X:  [ceil(m / NR)][K][NR]      X(k, j) = PX[((j / NR) K + k) NR + j % NR]
//
// One work-item owns a macro-tile of MC x TC of C in one slice of K, and loops over the micro-tiles
// that reach the wanted triangle; macro-tiles outside it end at once. With a single slice the result
// is C; with several each leaves its sums in [slice][m][leading], and add_slices adds them in order:
// a matrix of few columns has few macro-tiles, and long sums keep their accuracy.
//
// TRIANGLE  1: C(i, j), j <= i, is written, and what lies above the diagonal within a micro-tile
//           2: j <= i alone; 3: j >= i alone
// MC  rows of a macro-tile, a multiple of MR
// TC  columns of a macro-tile, a multiple of NR
// KC  depth of a block: so much of a panel stays in the first cache
#include "vector_width.cl"
#include "micro_tile.cl"

#ifndef MC
#define MC 96
#endif
#ifndef TC
#define TC (8 * NR)
#endif
#ifndef KC
#define KC (10 * NR)
#endif

#ifndef TRIANGLE
#define TRIANGLE 1
#endif

#define MULTIPLY_ROW(r) MULTIPLY(r, a[r])

// Row r of a micro-tile that the diagonal cuts, or the matrix's edge: columns [first, last).
#define STORE_PART(r)                                                                     \
  if (r < rows) {                                                                         \
    __global real* c = c_tile + r * c_row;                                                \
    real row[NR];                                                                         \
    storev(x##r, row);                                                                    \
    storev(y##r, row + VW);                                                               \
    storev(z##r, row + 2 * VW);                                                           \
    const ulong at = i + r;                                                               \
    const uint first = TRIANGLE == 3 && at > j ? (uint)(at - j) : 0;                      \
    const uint last = TRIANGLE == 2 ? (uint)min((ulong)columns, at + 1 - min(j, at + 1))  \
                                    : columns;                                            \
    for (uint n = first; n < last; ++n) {                                                 \
      c[n] = block_beta == 0 ? alpha * row[n] : alpha * row[n] + block_beta * c[n];       \
    }                                                                                     \
  }

// Work-item (macro-tile of columns, slice x macro-tile of rows); slices hold slice_depth of K.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void syrk_packed(ulong m, ulong K, ulong slice_depth, real alpha,
                          __global const real* restrict PX, real beta, __global real* restrict C,
                          ulong c_offset, ulong c_row, ulong c_slice) {
  const ulong row_tiles = (m + MC - 1) / MC;
  const ulong slice = get_global_id(1) / row_tiles;
  const ulong i_begin = get_global_id(1) % row_tiles * MC;
  const ulong j_begin = get_global_id(0) * TC;
#if TRIANGLE == 3
  const ulong j_end = min(j_begin + TC, m);
  const ulong i_end = min(i_begin + MC, j_end);
#else
  const ulong i_end = min(i_begin + MC, m);
  const ulong j_end = min(j_begin + TC, i_end);
#endif
  const ulong slice_begin = slice * slice_depth;
  const ulong slice_end = min(slice_begin + slice_depth, K);
  for (ulong k_begin = slice_begin; k_begin < slice_end; k_begin += KC) {
    const uint depth = (uint)min((ulong)KC, slice_end - k_begin);
    const real block_beta = k_begin == slice_begin ? beta : 1;
    for (ulong j = j_begin; j < j_end; j += NR) {
      const uint columns = (uint)min((ulong)NR, m - j);
      // Micro-tiles before the first one, or after the last, lie beyond the diagonal.
#if TRIANGLE == 3
      const ulong i_first = i_begin, i_last = min(i_end, j + NR);
#else
      const ulong i_first = max(i_begin, j / MR * MR), i_last = i_end;
#endif
      for (ulong i = i_first; i < i_last; i += MR) {
        const uint rows = (uint)min((ulong)MR, m - i);
        FOR_ROWS(DECLARE)
        __global const real* a = PX + ((i / NR) * K + k_begin) * NR + i % NR;
        __global const real* b = PX + ((j / NR) * K + k_begin) * NR;
        UNROLL
        for (uint k = 0; k < depth; ++k, a += NR, b += NR) {
          const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
          FOR_ROWS(MULTIPLY_ROW)
        }
        __global real* c_tile = C + c_offset + slice * c_slice + i * c_row + j;
        const bool whole = TRIANGLE == 2 ? j + NR <= i + 1 : TRIANGLE == 3 ? i + MR <= j + 1 : true;
        if (whole && columns == NR) {
          FOR_ROWS(STORE)
        } else {
          FOR_ROWS(STORE_PART)
        }
      }
    }
  }
}

// C = alpha (sum of slices) + beta C in the triangle; slices hold the lower one. Work-item: a row.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void add_slices(ulong m, ulong slices, ulong slice_row, ulong slice_stride, real alpha,
                         __global const real* restrict partial, real beta,
                         __global real* restrict C, ulong c_offset, ulong c_row) {
  const ulong i = get_global_id(0);
  __global real* c = C + c_offset + i * c_row;
#if TRIANGLE == 3
  for (ulong j = i; j < m; ++j) {
    __global const real* p = partial + j * slice_row + i;
#else
  for (ulong j = 0; j <= i; ++j) {
    __global const real* p = partial + i * slice_row + j;
#endif
    real sum = p[0];
    for (ulong slice = 1; slice < slices; ++slice) sum += p[slice * slice_stride];
    c[j] = beta == 0 ? alpha * sum : alpha * sum + beta * c[j];
  }
}
