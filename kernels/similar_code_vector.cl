// The most similar code-vector of each of many vectors (Havran et al., section 4.4.2). The value x
// of a vector is a texel whose window has the mean mu and the deviation sigma; in its place a
// code-vector has s L_j or A_j, which is d more. With the window's weight w of its centre
//
//   e = 2 w mu,  b = 2 sigma^2 + C2                p = (w d)^2
//   N = e^2 / (2 w^2) + C1 + e d                   q = w (1 - w) d^2
//   M = b + (2 w x - e) d
//   1 - SSIM = (p (M + q) + q N) / ((N + p) (M + q))
//
// and a code-vector's dissimilarity is the least that all values but `outliers` do not exceed. It
// is left as soon as more of them exceed that of the best so far, which takes no division.
//
//   vectors:      x, e, b                [vectors][groups of VW]   luminances, chromaticities
//   code_vectors:                        [count][groups of VW]     each padded with zeros
//   best, index:  [vectors]   dissimilarity and number of the best so far; at first what is allowed,
//                             and NONE
//
// Short vectors, without outliers, are interleaved: lanes are vectors. Theirs are [panels][values][VW].
//
// What is found does not depend on where the search begins. Where any dissimilarity is allowed, it
// begins with the code-vector that is most similar in some of the values.
//
// Groups pass by from the middle of the luminances on, where lights are high. Those that exceed are
// counted as soon as they can be too many, and then after every few groups.
//
// GUESS  groups that the first one is chosen by
#include "vector_width.cl"

#ifndef GUESS
#define GUESS 16
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
  float c1;
  float twice;    // 2 w
  float squared;  // w^2
  float rest;     // w (1 - w)
  float mean;     // 1 / (2 w^2)
} Window;

inline Window window_of(float c1, float w) {
  const Window window = {c1, 2.0f * w, w * w, w * (1.0f - w), 0.5f / (w * w)};
  return window;
}

// Numerator and denominator of 1 - SSIM.
inline void compare_windows(const Window* window, realv x, realv e, realv b, realv y,
                            realv* numerator, realv* denominator) {
  const realv d = y - x;
  const realv square = d * d;
  const realv n = fma(e, d, fma(window->mean * e, e, (realv)window->c1));
  const realv m = fma((realv)window->rest, square, fma(fma((realv)window->twice, x, -e), d, b));
  *numerator = square * fma((realv)window->squared, m, window->rest * n);
  *denominator = fma((realv)window->squared, square, n) * m;
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

// The code-vector with the least sum of dissimilarities in GUESS groups.
inline uint first_guess(const Window* window, ulong luminance_groups, ulong groups, uint count,
                        float scale, __global const float* x, __global const float* e,
                        __global const float* b, __global const float* code_vectors) {
  const ulong step = max(groups / GUESS, (ulong)1);
  float least = INFINITY;
  uint guess = 0;
  for (uint j = 0; j < count; ++j) {
    realv sum = 0.0f;
    for (ulong k = step / 2; k < groups; k += step) {
      const realv y =
          (k < luminance_groups ? scale : 1.0f) * loadv(code_vectors + (j * groups + k) * VW);
      realv numerator, denominator;
      compare_windows(window, loadv(x + k * VW), loadv(e + k * VW), loadv(b + k * VW), y,
                      &numerator, &denominator);
      const realv dissimilarity = numerator / denominator;
      sum += dissimilarity > 0.0f ? dissimilarity : (realv)0.0f;
    }
    float lanes[VW];
    storev(sum, lanes);
    float all_lanes = 0.0f;
    for (uint lane = 0; lane < VW; ++lane) all_lanes += lanes[lane];
    if (all_lanes < least) {
      least = all_lanes;
      guess = j;
    }
  }
  return guess;
}

// Work-item (vector). `room` holds the dissimilarities of one code-vector.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void similar_code_vector(ulong luminance_groups, ulong groups, uint outliers, uint count,
                                  uint first_number, float c1, float w,
                                  __global const float* restrict all_x,
                                  __global const float* restrict all_e,
                                  __global const float* restrict all_b,
                                  __global const float* restrict scales,
                                  __global const float* restrict code_vectors,
                                  __global float* restrict all_room, __global float* restrict best,
                                  __global uint* restrict index) {
  const Window window = window_of(c1, w);
  const ulong i = get_global_id(0);
  __global const float* x = all_x + i * groups * VW;
  __global const float* e = all_e + i * groups * VW;
  __global const float* b = all_b + i * groups * VW;
  __global float* room = all_room + i * groups * VW;
  const float scale = scales[i];
  float bound = best[i];
  uint number = index[i];
  const uint guess =
      bound < INFINITY
          ? 0
          : first_guess(&window, luminance_groups, groups, count, scale, x, e, b, code_vectors);
  const ulong middle = (luminance_groups > 0 ? luminance_groups : groups) / 2;
  const ulong fewest = outliers / VW + 1;
  const ulong run = max(fewest / 4, (ulong)2);
  for (uint t = 0; t <= count; ++t) {
    if (t == guess + 1) continue;
    const uint j = t == 0 ? guess : t - 1;
    __global const float* code_vector = code_vectors + j * groups * VW;
    int exceeding = 0;
    ulong end = 0;
    for (ulong first = 0; first < groups && exceeding <= (int)outliers; first = end) {
      end = min(first == 0 ? fewest : first + run, groups);
      intv above = 0;
      for (ulong n = first; n < end; ++n) {
        const ulong k = n + middle < groups ? n + middle : n + middle - groups;
        const realv y = (k < luminance_groups ? scale : 1.0f) * loadv(code_vector + k * VW);
        realv numerator, denominator;
        compare_windows(&window, loadv(x + k * VW), loadv(e + k * VW), loadv(b + k * VW), y,
                        &numerator, &denominator);
        above -= numerator > bound * denominator;
      }
      exceeding += lane_sum(above);
    }
    if (exceeding > (int)outliers) continue;
    for (ulong k = 0; k < groups; ++k) {
      const realv y = (k < luminance_groups ? scale : 1.0f) * loadv(code_vector + k * VW);
      realv numerator, denominator;
      compare_windows(&window, loadv(x + k * VW), loadv(e + k * VW), loadv(b + k * VW), y,
                      &numerator, &denominator);
      const realv dissimilarity = numerator / denominator;
      storev(dissimilarity > 0.0f ? dissimilarity : (realv)0.0f, room + k * VW);
    }
    const float found = percentile(room, groups, (int)outliers, bound);
    if (number != NONE && (found > bound || (found == bound && first_number + j > number))) continue;
    bound = found;
    number = first_number + j;
  }
  best[i] = bound;
  index[i] = number;
}

// Work-item (panel of VW vectors), of few values without outliers.
WIDE_VECTORS __attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void similar_short_vector(uint luminances, uint values, uint count, uint first_number,
                                   float c1, float w, __global const float* restrict x,
                                   __global const float* restrict e,
                                   __global const float* restrict b,
                                   __global const float* restrict scales,
                                   __global const float* restrict code_vectors,
                                   __global float* restrict best, __global int* restrict index) {
  const Window window = window_of(c1, w);
  const ulong i = get_global_id(0) * VW;
  const ulong panel = i * values;
  const realv scale = loadv(scales + i);
  realv bound = loadv(best + i);
  intv number = loadi(index + i);
  for (uint j = 0; j < count; ++j) {
    __global const float* code_vector = code_vectors + (ulong)j * values;
    realv most = 0.0f;
    for (uint k = 0; k < values; ++k) {
      const ulong at = panel + k * VW;
      const realv y = (k < luminances ? scale : (realv)1.0f) * code_vector[k];
      realv numerator, denominator;
      compare_windows(&window, loadv(x + at), loadv(e + at), loadv(b + at), y, &numerator,
                      &denominator);
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
