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
//   numbers:      [rows of groups MR]
//   best, index:  [panels NR]             score and number of the best so far
//
// Where both are in the order of their norms, a block of GROUP MR code-vectors whose norms are in
// [L_low, L_high] and [A_low, A_high] can't score more than by the triangle inequality
//
//   score <= (|l'|^2 + |a|^2 - D) / 2,   D >= (|l'| - s |L'|)^2 + (|a| - |A|)^2
//
// and is skipped where that is less than the best of every lane by more than scores are rounded.
// Blocks are looked at from the one on whose norms are next to the panel's.
//
//   norms:        [panels][2][NR]         |l'|, |a|
//   ranges:       [blocks][4]             L_low, L_high, A_low, A_high
//   start:        [panels]                block
//
// KC     values of a run
// GROUP  rows of MR code-vectors whose scores are kept: a block
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

// Interleaves `lanes` rows of [count][luminances + chromaticities] in the order of their numbers,
// luminances without their scale and times it; the rows' scales are 1 where `scaled` is 0. Scales are
// in that order, too. Work-item (block of KC values, panel of rows).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pack_vectors(ulong luminances, ulong values, ulong count, ulong lanes, uint scaled,
                           __global const float* restrict rows, __global const float* restrict scales,
                           __global const uint* restrict numbers, __global float* restrict packed) {
  const ulong first = get_global_id(0) * KC;
  const ulong end = min(first + KC, values);
  __global float* out = packed + get_global_id(1) * values * lanes;
  // some values of all rows after each other: what is written stays in a cache for all of them
  for (ulong k0 = first; k0 < end; k0 += 16) {
    const ulong k1 = min(k0 + 16, end);
    const int whole = k1 - k0 == 16 && (k1 <= luminances || k0 >= luminances);
    for (ulong lane = 0; lane < lanes; ++lane) {
      const ulong row = get_global_id(1) * lanes + lane;
      __global float* to = out + k0 * lanes + lane;
      if (row >= count) {
        for (ulong k = 0; k < k1 - k0; ++k) to[k * lanes] = 0.0f;
        continue;
      }
      const float scale = scaled ? scales[row] : 1.0f;
      __global const float* in = rows + numbers[row] * values;
      if (!whole) {
        for (ulong k = k0; k < k1; ++k) {
          to[(k - k0) * lanes] = k < luminances ? scale * (in[k] - scale) : in[k];
        }
        continue;
      }
      const float16 given = vload16(0, in + k0);
      float row_values[16];
      vstore16(k0 < luminances ? scale * (given - scale) : given, 0, row_values);
      for (uint k = 0; k < 16; ++k) to[k * lanes] = row_values[k];
    }
  }
}

// Half the sum of (x - shift)^2 over n values, in runs.
inline float half_square(__global const float* x, ulong n, float shift) {
  float total = 0.0f;
  for (ulong first = 0; first < n; first += KC) {
    const ulong end = min(first + KC, n);
    realv sums = 0.0f;
    ulong k = first;
    for (; k + VW <= end; k += VW) {
      const realv d = loadv(x + k) - shift;
      sums = fma(0.5f * d, d, sums);
    }
    float lanes[VW];
    storev(sums, lanes);
    float sum = 0.0f;
    for (uint lane = 0; lane < VW; ++lane) sum += lanes[lane];
    for (; k < end; ++k) sum = fma(0.5f * (x[k] - shift), x[k] - shift, sum);
    total += sum;
  }
  return total;
}

// Half the squares of rows, of luminances without their scale, which is 1 where `scaled` is 0.
// Work-item (row).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void half_squares(ulong luminances, ulong values, uint scaled,
                           __global const float* restrict rows, __global const float* restrict scales,
                           __global float* restrict squares) {
  const ulong row = get_global_id(0);
  const float scale = scaled ? scales[row] : 1.0f;
  __global const float* x = rows + row * values;
  squares[2 * row] = half_square(x, luminances, scale);
  squares[2 * row + 1] = half_square(x + luminances, values - luminances, 0.0f);
}

// How far x is from [low, high].
inline realv distance_to(realv x, realv low, realv high) {
  const realv below = low - x;
  const realv above = x - high;
  const realv outside = below > above ? below : above;
  return outside > 0.0f ? outside : (realv)0.0f;
}

// Whether no code-vector of a block can be the nearest of any of VW vectors. Scores and norms are
// within 2^-14 of the squares that they are made of.
inline int is_beyond(realv luminance, realv chromaticity, realv scale, realv best,
                     __global const float* range) {
  const realv low = scale * range[0];
  const realv high = scale * range[1];
  const realv l = distance_to(luminance, low, high);
  const realv a = distance_to(chromaticity, (realv)range[2], (realv)range[3]);
  const realv squares = luminance * luminance + chromaticity * chromaticity;
  const realv most = 0.5f * (squares - l * l - a * a);
  const realv rounding = 0x1p-14f * (squares + high * high + range[3] * range[3]);
  return all(most + rounding < best);
}

#define ROW(r) float* row##r = scores + (g * MR + r) * NR;
#define ADD(r) MULTIPLY(r, c[r])
#define KEEP(r)                                           \
  storev(x##r + loadv(row##r), row##r);                   \
  storev(y##r + loadv(row##r + VW), row##r + VW);         \
  storev(z##r + loadv(row##r + 2 * VW), row##r + 2 * VW);

// Work-item (panel). The code-vectors of these rows are numbered from first_number on; the first of
// equal ones is taken.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void nearest_code_vector(ulong values, ulong groups, uint first_number, uint pruned,
                                  __global const float* restrict vectors,
                                  __global const float* restrict scales,
                                  __global const float* restrict norms,
                                  __global const uint* restrict start,
                                  __global const float* restrict code_vectors,
                                  __global const float* restrict squares,
                                  __global const uint* restrict numbers,
                                  __global const float* restrict ranges,
                                  __global float* restrict best, __global int* restrict index) {
  const ulong panel = get_global_id(0);
  __global const float* panel_vectors = vectors + panel * values * NR;
  __global const float* panel_scales = scales + panel * NR;
  const long blocks = (long)((groups + GROUP - 1) / GROUP);
  const long near = pruned ? (long)start[panel] : 0;
  float scores[GROUP * MR * NR];
  for (long t = 0; t < 2 * blocks; ++t) {
    // near, near + 1, near - 1, near + 2 ...
    const long block = near + ((t & 1) ? (t + 1) / 2 : -(t / 2));
    if (block < 0 || block >= blocks) continue;
    if (pruned) {
      int beyond = 1;
      for (uint lane = 0; lane < NR && beyond; lane += VW) {
        const ulong at = panel * 2 * NR + lane;
        beyond = is_beyond(loadv(norms + at), loadv(norms + at + NR), loadv(panel_scales + lane),
                           loadv(best + panel * NR + lane), ranges + 4 * block);
      }
      if (beyond) continue;
    }
    const ulong first = (ulong)block * GROUP;
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
        const intv candidate = (intv)(int)(first_number + numbers[first * MR + r]);
        const intv better = (score > most) | ((score == most) & (candidate < number));
        most = select(most, score, better);
        number = select(number, candidate, better);
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
