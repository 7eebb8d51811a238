// Product of a few long rows with their own transpose, for CPU devices:
//
//   C(i, j) = sum_k X(i, k) X(j, k),   j <= i           X: m x K, row-major, K far longer than m
//
// Neighbours of a row fill a vector, so that nothing is transposed: a tile of C is TILE x TILE
// vectors of partial sums, X(i, k + lane) X(j, k + lane), whose lanes are added up at the end.
//
//   X(i, k) = X[x_offset + i x_row + k]
//   copy:    [slice][m][depth]    a block of columns, since rows that lie powers of two apart share
//                                 few places of a cache; depth is a multiple of VW
//   partial: [slice][m][c_row]    sums of a slice of K, added up by add_slices of syrk.cl
//
// Work-item: a slice of K. TILE is 5 where there are 32 vector registers, else 3.
//
// MR  8 where there are 32 vector registers, else 4
#include "vector_width.cl"

#ifndef MR
#define MR 4
#endif

#if MR == 8
#define TILE 5
#define FOR_TILE(X) X(0) X(1) X(2) X(3) X(4)
#define FOR_ROW(X, i) X(i, 0) X(i, 1) X(i, 2) X(i, 3) X(i, 4)
#else
#define TILE 3
#define FOR_TILE(X) X(0) X(1) X(2)
#define FOR_ROW(X, i) X(i, 0) X(i, 1) X(i, 2)
#endif

inline real sum_lanes(realv x) {
#if VW == 16
  const real8 eight = x.lo + x.hi;
#elif VW == 8
  const real8 eight = x;
#endif
#if VW == 4
  const real4 four = x;
#else
  const real4 four = eight.lo + eight.hi;
#endif
  const real2 two = four.lo + four.hi;
  return two.x + two.y;
}

#define DECLARE(i, j) realv s##i##j = 0;
#define DECLARE_ROW(i) FOR_ROW(DECLARE, i)
#define A_POINTER(i) __global const real* a##i = block + min(i_begin + i, m - 1) * depth;
#define B_POINTER(j) __global const real* b##j = block + min(j_begin + j, m - 1) * depth;
#define LOAD_B(j) const realv y##j = loadv(b##j + k);
#define ADD(i, j) s##i##j = fma(x, y##j, s##i##j);
#define ADD_ROW(i)                  \
  {                                 \
    const realv x = loadv(a##i + k); \
    FOR_ROW(ADD, i)                 \
  }
#define STORE(i, j)                                                  \
  if (i_begin + i < m && j_begin + j <= i_begin + i) {               \
    const real sum = sum_lanes(s##i##j);                             \
    __global real* c = out + (i_begin + i) * c_row + j_begin + j;    \
    *c = k_begin == slice_begin ? sum : *c + sum;                    \
  }
#define STORE_ROW(i) FOR_ROW(STORE, i)

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void syrk_rows(ulong m, ulong K, ulong slice_depth, ulong depth, __global const real* restrict X,
                        ulong x_offset, ulong x_row, __global real* restrict copy,
                        __global real* restrict partial, ulong c_row) {
  const ulong slice = get_global_id(0);
  __global real* block = copy + slice * m * depth;
  __global real* out = partial + slice * m * c_row;
  const ulong slice_begin = slice * slice_depth;
  const ulong slice_end = min(slice_begin + slice_depth, K);
  for (ulong k_begin = slice_begin; k_begin < slice_end; k_begin += depth) {
    const uint count = (uint)min((ulong)depth, slice_end - k_begin);
    const uint whole = count / VW * VW;
    for (ulong i = 0; i < m; ++i) {
      __global const real* x = X + x_offset + i * x_row + k_begin;
      __global real* row = block + i * depth;
      for (uint k = 0; k < whole; k += VW) storev(loadv(x + k), row + k);
      if (whole < count) {
        for (uint k = whole; k < whole + VW; ++k) row[k] = k < count ? x[k] : 0;
      }
    }
    for (ulong i_begin = 0; i_begin < m; i_begin += TILE) {
      FOR_TILE(A_POINTER)
      for (ulong j_begin = 0; j_begin <= i_begin; j_begin += TILE) {
        FOR_TILE(B_POINTER)
        FOR_TILE(DECLARE_ROW)
        for (uint k = 0; k < count; k += VW) {
          FOR_TILE(LOAD_B)
          FOR_TILE(ADD_ROW)
        }
        FOR_TILE(STORE_ROW)
      }
    }
  }
}
