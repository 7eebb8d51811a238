// Mode-n product of a row-major tensor with a small matrix, for CPU devices, without an unfolding:
//
//   T:       [outer][n][inner]
//   out:     [outer][rows][inner]    out(o, r, i) = sum_j U(r, j) T(o, j, i)
//   packed:  [ceil(rows / MR)][n][MR]    U(r, j), zero past the last row
//
// A work-item holds `strips` strips of T, each NR columns wide, in memory of its own: [strip][depth][NR].
// They are read once, in runs as long as they are wide together, and serve all rows.
//
// Rows that lie anywhere are combined in the same way, columns [first, first + inner) of them:
//
//   out(r, i) = base(base_at[r] + first + i) + sum_j U(r, j) T(row_at[j] + first + i)
//
// KC        depth of a strip
// VALUES    that a work-item holds, strips x depth x NR at most
// GATHERED  1: combine_rows; 0: mode_product
#include "vector_width.cl"
#include "micro_tile.cl"

#ifndef KC
#define KC 384
#endif
#ifndef VALUES
#define VALUES 65536
#endif
#ifndef GATHERED
#define GATHERED 0
#endif

// U as it lies, U(r, j) = U[r u_row + j u_column], in panels of MR rows. Work-item: a panel.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_rows(ulong rows, ulong n, __global const float* restrict U, ulong u_row, ulong u_column,
                        __global float* restrict packed) {
  const ulong r_begin = get_global_id(0) * MR;
  __global float* out = packed + r_begin * n;
  for (ulong j = 0; j < n; ++j) {
    for (uint r = 0; r < MR; ++r) {
      out[j * MR + r] = r_begin + r < rows ? U[(r_begin + r) * u_row + j * u_column] : 0;
    }
  }
}

#define MULTIPLY_ALL(r) MULTIPLY(r, a[r])
#define MULTIPLY_TWO(r) MULTIPLY_PAIR(r, a[r])
#define MULTIPLY_ONE(r) MULTIPLY_NARROW(r, a[r])
#define ADD_TO(x, c) storev(block_beta == 0.0f ? x : x + loadv(c), c)
#define STORE_TWO(r)                       \
  if (r < rows) {                     \
    ADD_TO(x##r, c_tile + r * c_row);      \
    ADD_TO(y##r, c_tile + r * c_row + VW); \
  }
#define STORE_ONE(r) \
  if (r < rows) ADD_TO(x##r, c_tile + r * c_row);

// `columns` columns of a row in strips, `depth` rows deep, of which the first begins at `to`.
inline void copy_row(__global const float* restrict from, uint depth, uint columns, float* to) {
  const uint whole = columns / NR * NR;
  uint i = 0;
  for (; i < whole; i += NR, to += depth * NR) {
    storev(loadv(from + i), to);
    storev(loadv(from + i + VW), to + VW);
    storev(loadv(from + i + 2 * VW), to + 2 * VW);
  }
  uint rest = 0;
  for (; i + VW <= columns; i += VW, rest += VW) storev(loadv(from + i), to + rest);
  for (; i < columns; ++i, ++rest) to[rest] = from[i];
  for (; rest % NR != 0; ++rest) to[rest] = 0;
}

// Work-item (block of strips, o).
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
#if GATHERED
__kernel void combine_rows(ulong n, ulong inner, ulong rows_of_u, ulong strips,
                           __global const float* restrict T, __global const float* restrict packed,
                           __global float* restrict result, __global const ulong* restrict row_at,
                           __global const float* restrict base,
                           __global const ulong* restrict base_at, uint has_base, ulong first) {
#define ROW(j) (T + row_at[j] + first + i_begin)
#else
__kernel void mode_product(ulong n, ulong inner, ulong rows_of_u, ulong strips,
                           __global const float* restrict T, __global const float* restrict packed,
                           __global float* restrict result) {
#define ROW(j) (T + (o * n + j) * inner + i_begin)
#endif
  const ulong i_begin = get_global_id(0) * strips * NR;
  const ulong o = get_global_id(1);
  const uint width = (uint)min(strips * NR, inner - i_begin);
  const ulong c_row = inner;
  const float alpha = 1;
  float block[VALUES];
  float first_beta = 0;
#if GATHERED
  for (ulong r = 0; r < rows_of_u && has_base; ++r) {
    __global const float* from = base + base_at[r] + first + i_begin;
    __global float* to = result + r * inner + i_begin;
    uint i = 0;
    for (; i + VW <= width; i += VW) storev(loadv(from + i), to + i);
    for (; i < width; ++i) to[i] = from[i];
    first_beta = 1;
  }
#endif
  for (ulong j_begin = 0; j_begin < n; j_begin += KC) {
    const uint depth = (uint)min((ulong)KC, n - j_begin);
    const float block_beta = j_begin == 0 ? first_beta : 1;
    for (uint j = 0; j < depth; ++j) copy_row(ROW(j_begin + j), depth, width, block + j * NR);
    for (uint i = 0; i < width; i += NR) {
      const uint columns = min((uint)NR, width - i);
      const float* strip = block + i * depth;
      for (ulong r_begin = 0; r_begin < rows_of_u; r_begin += MR) {
        const uint rows = (uint)min((ulong)MR, rows_of_u - r_begin);
        __global const float* a = packed + r_begin * n + j_begin * MR;
        __global float* c_tile = result + (o * rows_of_u + r_begin) * inner + i_begin + i;
        const float* b = strip;
        FOR_ROWS(DECLARE)
        if (columns <= VW) {
          UNROLL
          for (uint j = 0; j < depth; ++j, a += MR, b += NR) {
            const realv b0 = loadv(b);
            FOR_ROWS(MULTIPLY_ONE)
          }
        } else if (columns <= 2 * VW) {
          UNROLL
          for (uint j = 0; j < depth; ++j, a += MR, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW);
            FOR_ROWS(MULTIPLY_TWO)
          }
        } else {
          UNROLL
          for (uint j = 0; j < depth; ++j, a += MR, b += NR) {
            const realv b0 = loadv(b), b1 = loadv(b + VW), b2 = loadv(b + 2 * VW);
            FOR_ROWS(MULTIPLY_ALL)
          }
        }
        if (columns == NR) {
          FOR_ROWS(STORE)
        } else if (columns == 2 * VW) {
          FOR_ROWS(STORE_TWO)
        } else if (columns == VW) {
          FOR_ROWS(STORE_ONE)
        } else {
          FOR_ROWS(STORE_EDGE)
        }
      }
    }
  }
}
