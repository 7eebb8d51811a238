// Product of a few long rows with their own transpose, for CPU devices:
//
//   C(i, j) = sum_k X(i, k) X(j, k),   j <= i           X: m x K, row-major, K far longer than m
//
// Neighbours of a row fill a vector, so that nothing is transposed: a tile of C is TILE x TILE
// vectors of partial sums, X(i, k + lane) X(j, k + lane), whose lanes are added up at the end.
//
//   X(i, k) = X[x_offset + (k / inner) x_batch + i x_row + k % inner]
//                                 a matrix in parts of `inner` columns: the mode-n unfolding of a tensor
//                                 [outer][m][inner], where it lies
//   copy:    [slice][m][depth]    a block of columns, since rows that lie powers of two apart share
//                                 few places of a cache; depth is a multiple of VW
//   partial: [slice][m][c_row]    sums of a slice of K, added up by add_slices of syrk.cl
//
// Work-item: a slice of K. TILE is 5 where there are 32 vector registers, else 3.
//
// MR      8 where there are 32 vector registers, else 4
// X_BITS  32 or 64: what X holds; floats are widened for sums in double
#include "vector_width.cl"

#ifndef MR
#define MR 4
#endif

#ifndef X_BITS
#define X_BITS ARITHMETIC
#endif
#if X_BITS == ARITHMETIC
typedef real x_real;
#define load_x(p) loadv(p)
#elif VW == 4
typedef float x_real;
#define load_x(p) convert_double4(vload4(0, p))
#else
typedef float x_real;
#define load_x(p) convert_double8(vload8(0, p))
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

// Copies columns [k_begin, k_begin + count) of X into a block, zero up to a whole vector.
inline void copy_block(ulong m, ulong inner, ulong k_begin, uint count, ulong depth,
                       __global const x_real* restrict X, ulong x_row, ulong x_batch,
                       __global real* restrict block) {
  uint run = 0;
  for (uint k = 0; k < count; k += run) {
    const ulong part = (k_begin + k) / inner;
    const ulong first = (k_begin + k) % inner;
    run = (uint)min(inner - first, (ulong)(count - k));
    for (ulong i = 0; i < m; ++i) {
      __global const x_real* x = X + part * x_batch + i * x_row + first;
      __global real* row = block + i * depth + k;
      uint j = 0;
      for (; j + VW <= run; j += VW) storev(load_x(x + j), row + j);
      if (j < run && run >= VW) {
        storev(load_x(x + run - VW), row + run - VW);
      } else {
        for (; j < run; ++j) row[j] = x[j];
      }
    }
  }
  const uint whole = (count + VW - 1) / VW * VW;
  if (whole == count) return;
  for (ulong i = 0; i < m; ++i) {
    for (uint k = count; k < whole; ++k) block[i * depth + k] = 0;
  }
}

WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void syrk_rows(ulong m, ulong K, ulong slice_depth, ulong depth, __global const x_real* restrict X,
                        ulong x_offset, ulong x_row, ulong inner, ulong x_batch,
                        __global real* restrict copy, __global real* restrict partial, ulong c_row) {
  const ulong slice = get_global_id(0);
  __global real* block = copy + slice * m * depth;
  __global real* out = partial + slice * m * c_row;
  const ulong slice_begin = slice * slice_depth;
  const ulong slice_end = min(slice_begin + slice_depth, K);
  for (ulong k_begin = slice_begin; k_begin < slice_end; k_begin += depth) {
    const uint count = (uint)min((ulong)depth, slice_end - k_begin);
    copy_block(m, inner, k_begin, count, depth, X + x_offset, x_row, x_batch, block);
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
