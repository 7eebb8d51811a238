// The mode-n unfolding of a row-major tensor, packed in the panels that products with its transpose
// take; the tensor is not unfolded in memory.
//
//   T:       [outer][n][inner], T(o, j, i) = T[o n inner + j inner + i]
//   panels:  [ceil(n / NR)][rows][NR]        panels(k, j) = T(o, j, i) with first_row + k = o inner + i,
//            zero past the last j
//
// Work-item (panel, block of ROWS rows).
//
// ROWS  rows that a work-item packs
#include "vector_width.cl"

#ifndef ROWS
#define ROWS 512
#endif

#if ARITHMETIC == 64
#define convert_real4(x) convert_double4(x)
#else
#define convert_real4(x) (x)
#endif

#define STORE_ROW(s) vstore4((real4)(x0.s, x1.s, x2.s, x3.s), 0, to), to += NR;

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_mode(__global const float* restrict T, ulong n, ulong inner, ulong first_row,
                        ulong rows, __global real* restrict panels) {
  const ulong panel = get_global_id(0);
  const ulong j_begin = panel * NR;
  const uint columns = (uint)min((ulong)NR, n - j_begin);
  const ulong begin = get_global_id(1) * ROWS;
  const ulong end = min(begin + ROWS, rows);
  __global real* out = panels + (panel * rows + begin) * NR;
  for (ulong k = begin; k < end;) {
    // rows of one o
    const ulong o = (first_row + k) / inner;
    const ulong i = (first_row + k) % inner;
    const ulong stop = min(end, k + inner - i);
    __global const float* from = T + (o * n + j_begin) * inner + i;
    if (inner > 1) {
      // turn blocks of 8 rows and 4 columns
      for (; k + 8 <= stop; k += 8, from += 8, out += 8 * NR) {
        for (uint j = 0; j < NR; j += 4) {
          __global real* to = out + j;
          real8 x0 = 0, x1 = 0, x2 = 0, x3 = 0;
          if (j < columns) x0 = convert_real8(vload8(0, from + j * inner));
          if (j + 1 < columns) x1 = convert_real8(vload8(0, from + (j + 1) * inner));
          if (j + 2 < columns) x2 = convert_real8(vload8(0, from + (j + 2) * inner));
          if (j + 3 < columns) x3 = convert_real8(vload8(0, from + (j + 3) * inner));
          STORE_ROW(s0) STORE_ROW(s1) STORE_ROW(s2) STORE_ROW(s3)
          STORE_ROW(s4) STORE_ROW(s5) STORE_ROW(s6) STORE_ROW(s7)
        }
      }
    } else if (columns == NR) {
      for (uint j = 0; j < NR; j += 4) vstore4(convert_real4(vload4(0, from + j)), 0, out + j);
      ++k;
      out += NR;
      continue;
    }
    for (; k < stop; ++k, ++from, out += NR) {
      for (uint j = 0; j < columns; ++j) out[j] = from[j * inner];
      for (uint j = columns; j < NR; ++j) out[j] = 0;
    }
  }
}
