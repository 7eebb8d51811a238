// The most similar code-vector of each of many vectors (Havran et al., section 4.4.2). The value x
// of a vector is a texel whose window has the mean mu and the deviation sigma; in its place a
// code-vector has s L_j or A_j, which is d more. With the window's weight w of its centre
//
//   N = 2 mu (mu + w d) + C1                       p = (w d)^2
//   M = 2 sigma^2 + 2 w d (x - mu) + C2            q = w (1 - w) d^2
//   1 - SSIM = (p (M + q) + q N) / ((N + p) (M + q))
//
// and a code-vector's dissimilarity is the least that all values but `outliers` do not exceed. It
// is left as soon as more of them exceed that of the best so far, which takes no division.
//
//   vectors:      x, means, deviations   [vectors][groups of VW]   luminances, chromaticities
//   code_vectors:                        [count][groups of VW]     each padded with zeros
//   best, index:  [vectors]   dissimilarity and number of the best so far; at first what is allowed,
//                             and NONE
//
// Short vectors, without outliers, are interleaved: lanes are vectors. Theirs are [panels][values][VW].
//
// RUN  groups after which those that exceed are counted
#include "vector_width.cl"

#ifndef RUN
#define RUN 16
#endif
#define NONE 0xffffffffu
#if VW == 16
#define intv int16
#define as_intv as_int16
#define loadi(p) vload16(0, p)
#else
#define intv int8
#define as_intv as_int8
#define loadi(p) vload8(0, p)
#endif

typedef struct {
  float c1, c2, w;
  float q;  // of q = that times p: (1 - w) / w
} Window;

// Numerator and denominator of 1 - SSIM.
inline void compare_windows(const Window* window, realv x, realv mean, realv deviation, realv y,
                            realv* numerator, realv* denominator) {
  const realv wd = window->w * (y - x);
  const realv p = wd * wd;
  const realv q = window->q * p;
  const realv n = fma(2.0f * mean, mean + wd, (realv)window->c1);
  const realv m =
      fma(2.0f * wd, x - mean, fma(2.0f * deviation, deviation, (realv)window->c2)) + q;
  *numerator = fma(p, m, q * n);
  *denominator = (n + p) * m;
}

// Sum of lanes.
inline int lane_sum(intv v) {
#if VW == 16
  const int8 eight = v.lo + v.hi;
#else
  const int8 eight = v;
#endif
  const int4 four = eight.lo + eight.hi;
  return (four.x + four.y) + (four.z + four.w);
}

// The least of `groups` of dissimilarities, at most `bound`, that all but `outliers` don't exceed:
// their bits are in the order of their values.
inline float percentile(__global const float* values, ulong groups, int outliers, float bound) {
  int low = -1;
  int high = as_int(bound);
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    intv above = 0;
    for (ulong k = 0; k < groups; ++k) above -= as_intv(loadv(values + k * VW)) > middle;
    if (lane_sum(above) > outliers) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return as_float(high);
}

// Work-item (vector). `room` holds the dissimilarities of one code-vector.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void similar_code_vector(ulong luminance_groups, ulong groups, uint outliers, uint count,
                                  uint first_number, float c1, float c2, float w,
                                  __global const float* restrict x,
                                  __global const float* restrict means,
                                  __global const float* restrict deviations,
                                  __global const float* restrict scales,
                                  __global const float* restrict code_vectors,
                                  __global float* restrict room, __global float* restrict best,
                                  __global uint* restrict index) {
  const Window window = {c1, c2, w, (1.0f - w) / w};
  const ulong i = get_global_id(0);
  const ulong row = i * groups * VW;
  const float scale = scales[i];
  float bound = best[i];
  uint number = index[i];
  for (uint j = 0; j < count; ++j) {
    __global const float* code_vector = code_vectors + j * groups * VW;
    int exceeding = 0;
    for (ulong first = 0; first < groups && exceeding <= (int)outliers; first += RUN) {
      intv above = 0;
      for (ulong k = first; k < min(first + RUN, groups); ++k) {
        const realv y = (k < luminance_groups ? scale : 1.0f) * loadv(code_vector + k * VW);
        realv numerator, denominator;
        compare_windows(&window, loadv(x + row + k * VW), loadv(means + row + k * VW),
                        loadv(deviations + row + k * VW), y, &numerator, &denominator);
        above -= numerator > bound * denominator;
      }
      exceeding += lane_sum(above);
    }
    if (exceeding > (int)outliers) continue;
    for (ulong k = 0; k < groups; ++k) {
      const realv y = (k < luminance_groups ? scale : 1.0f) * loadv(code_vector + k * VW);
      realv numerator, denominator;
      compare_windows(&window, loadv(x + row + k * VW), loadv(means + row + k * VW),
                      loadv(deviations + row + k * VW), y, &numerator, &denominator);
      const realv dissimilarity = numerator / denominator;
      storev(dissimilarity > 0.0f ? dissimilarity : (realv)0.0f, room + row + k * VW);
    }
    const float found = percentile(room + row, groups, (int)outliers, bound);
    if (number != NONE && found >= bound) continue;
    bound = found;
    number = first_number + j;
  }
  best[i] = bound;
  index[i] = number;
}

// Work-item (panel of VW vectors), of few values without outliers.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void similar_short_vector(uint luminances, uint values, uint count, uint first_number,
                                   float c1, float c2, float w, __global const float* restrict x,
                                   __global const float* restrict means,
                                   __global const float* restrict deviations,
                                   __global const float* restrict scales,
                                   __global const float* restrict code_vectors,
                                   __global float* restrict best, __global int* restrict index) {
  const Window window = {c1, c2, w, (1.0f - w) / w};
  const ulong i = get_global_id(0) * VW;
  const ulong panel = i * values;
  const realv scale = loadv(scales + i);
  realv bound = loadv(best + i);
  intv number = loadi(index + i);
  for (uint j = 0; j < count; ++j) {
    __global const float* code_vector = code_vectors + (ulong)j * values;
    realv most = 0.0f;
    for (uint k = 0; k < values; ++k) {
      const realv y = (k < luminances ? scale : (realv)1.0f) * code_vector[k];
      realv numerator, denominator;
      compare_windows(&window, loadv(x + panel + k * VW), loadv(means + panel + k * VW),
                      loadv(deviations + panel + k * VW), y, &numerator, &denominator);
      const realv dissimilarity = numerator / denominator;
      most = dissimilarity > most ? dissimilarity : most;
      if (k % 4 == 3 && all(most > bound)) break;
    }
    const intv better = (most < bound) | ((most == bound) & (number == (int)NONE));
    bound = better ? most : bound;
    number = better ? (intv)(int)(first_number + j) : number;
  }
  storev(bound, best + i);
#if VW == 16
  vstore16(number, 0, index + i);
#else
  vstore8(number, 0, index + i);
#endif
}
