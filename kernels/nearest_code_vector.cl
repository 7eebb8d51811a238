// The nearest code-vector of each of many vectors without a matrix of distances (Havran et al.,
// section 4.2). Vectors are luminances l and chromaticities a, and luminances are compared without
// their scale s:
//
//   D(x, j) = |l_x - s L_j|^2 + |a_x - A_j|^2
//
// With l' = l - s and L' = L - 1, which have shorter sums, the least D has the largest
//
//   score = s l'_x . L'_j + a_x . A_j - s^2 |L'_j|^2 / 2 - |A_j|^2 / 2
//
// Lanes are NR vectors, rows are MR code-vectors. Scores of GROUP MR code-vectors are summed a run
// of KC values at a time, so that a panel's run stays in a cache while these pass by, and sums stay
// short.
//
//   vectors:      [panels][values][NR]    s l' and a, zero-padded
//   scales:       [panels NR]
//   code_vectors: [rows of groups][values][MR]   L' and A
//   squares:      [rows of groups MR][2]  |L'|^2 / 2, |A|^2 / 2; the second large in padding
//   best, index:  [panels NR]             score and number of the best so far
//
// KC     values of a run
// GROUP  rows of MR code-vectors whose scores are kept
#include "vector_width.cl"
#include "micro_tile.cl"

#ifndef KC
#define KC 256
#endif
#ifndef GROUP
#define GROUP 8
#endif
#if VW == 16
#define intv int16
#else
#define intv int8
#endif

// Interleaves `lanes` rows of [count][luminances + chromaticities], luminances without their scale
// and times it; the rows' scales are 1 where `scaled` is 0. Work-item (block of KC values, panel of
// rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_vectors(ulong luminances, ulong values, ulong count, ulong lanes, uint scaled,
                           __global const float* restrict rows, __global const float* restrict scales,
                           __global float* restrict packed) {
  const ulong first = get_global_id(0) * KC;
  const ulong end = min(first + KC, values);
  __global float* out = packed + get_global_id(1) * values * lanes;
  for (ulong lane = 0; lane < lanes; ++lane) {
    const ulong row = get_global_id(1) * lanes + lane;
    if (row >= count) {
      for (ulong k = first; k < end; ++k) out[k * lanes + lane] = 0.0f;
      continue;
    }
    const float scale = scaled ? scales[row] : 1.0f;
    __global const float* in = rows + row * values;
    for (ulong k = first; k < end; ++k) {
      out[k * lanes + lane] = k < luminances ? scale * (in[k] - scale) : in[k];
    }
  }
}

// Half the squares of code-vectors' rows; padding is never the nearest. Work-item (row).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void half_squares(ulong luminances, ulong values, ulong count,
                           __global const float* restrict rows, __global float* restrict squares) {
  const ulong row = get_global_id(0);
  float sums[2] = {0.0f, row < count ? 0.0f : 1e30f};
  for (ulong k = 0; k < values && row < count; k += KC) {
    // a run of either part
    const uint part = k < luminances ? 0 : 1;
    float sum = 0.0f;
    for (ulong i = k; i < min(k + KC, values); ++i) {
      const float x = i < luminances ? rows[row * values + i] - 1.0f : rows[row * values + i];
      if (part == 0 && i >= luminances) {
        sums[1] = fma(0.5f * x, x, sums[1]);
      } else {
        sum = fma(0.5f * x, x, sum);
      }
    }
    sums[part] += sum;
  }
  squares[2 * row] = sums[0];
  squares[2 * row + 1] = sums[1];
}

#define ROW(r) float* row##r = scores + (g * MR + r) * NR;
#define ADD(r) MULTIPLY(r, c[r])
#define KEEP(r)                                           \
  storev(x##r + loadv(row##r), row##r);                   \
  storev(y##r + loadv(row##r + VW), row##r + VW);         \
  storev(z##r + loadv(row##r + 2 * VW), row##r + 2 * VW);

// Work-item (panel). The code-vectors are numbered from first_number on; the first of equal ones is
// taken.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void nearest_code_vector(ulong values, ulong groups, uint first_number,
                                  __global const float* restrict vectors,
                                  __global const float* restrict scales,
                                  __global const float* restrict code_vectors,
                                  __global const float* restrict squares,
                                  __global float* restrict best, __global int* restrict index) {
  const ulong panel = get_global_id(0);
  __global const float* panel_vectors = vectors + panel * values * NR;
  __global const float* panel_scales = scales + panel * NR;
  float scores[GROUP * MR * NR];
  for (ulong first = 0; first < groups; first += GROUP) {
    const uint count = (uint)min((ulong)GROUP, groups - first);
    for (uint r = 0; r < count * MR; ++r) {
      __global const float* square = squares + (first * MR + r) * 2;
      for (uint lane = 0; lane < NR; lane += VW) {
        const realv s = loadv(panel_scales + lane);
        storev(-s * s * square[0] - square[1], scores + r * NR + lane);
      }
    }
    for (ulong k0 = 0; k0 < values; k0 += KC) {
      const uint run = (uint)min((ulong)KC, values - k0);
      for (uint g = 0; g < count; ++g) {
        FOR_ROWS(ROW)
        FOR_ROWS(DECLARE)
        __global const float* b = panel_vectors + k0 * NR;
        __global const float* c = code_vectors + ((first + g) * values + k0) * MR;
        UNROLL
        for (uint k = 0; k < run; ++k) {
          const realv b0 = loadv(b);
          const realv b1 = loadv(b + VW);
          const realv b2 = loadv(b + 2 * VW);
          FOR_ROWS(ADD)
          b += NR;
          c += MR;
        }
        FOR_ROWS(KEEP)
      }
    }
    for (uint lane = 0; lane < NR; lane += VW) {
      realv most = loadv(best + panel * NR + lane);
      intv number;
#if VW == 16
      number = vload16(0, index + panel * NR + lane);
#else
      number = vload8(0, index + panel * NR + lane);
#endif
      for (uint r = 0; r < count * MR; ++r) {
        const realv score = loadv(scores + r * NR + lane);
        const intv better = score > most;
        most = select(most, score, better);
        number = select(number, (intv)(int)(first_number + (uint)first * MR + r), better);
      }
      storev(most, best + panel * NR + lane);
#if VW == 16
      vstore16(number, 0, index + panel * NR + lane);
#else
      vstore8(number, 0, index + panel * NR + lane);
#endif
    }
  }
}
