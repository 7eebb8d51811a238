// Sums of the errors of a reconstruction T' against raw values T:
//
//   partial[chunk] = (sum (s (T - T'))^2, sum (s T)^2, max |T - T'|, max |T|)
//
// A maximum is NaN where one of its values is.
//
//   raw:     [count] of the stored type
//   decoded: [count] of float
//
// s is a power of two that keeps the squares within float. Work-item (chunk). Within a chunk eight
// lanes add up at most CHUNK / 8 squares each; the host adds the chunks in double.
//
// CHUNK  values of a chunk, a multiple of 8
#include "tile_values.cl"

#ifndef CHUNK
#define CHUNK 2048
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void error_sums(__global const raw_t* restrict raw, __global const float* restrict decoded,
                         ulong count, float scale, __global float4* restrict partial) {
  const ulong chunk = get_global_id(0);
  const ulong begin = chunk * CHUNK;
  const ulong end = min(begin + CHUNK, count);
  float8 difference_squares = 0.0f, reference_squares = 0.0f;
  // Magnitudes as integers: they are ordered as their bits are, and a NaN is above them all, so that
  // it can't pass for a small error.
  int8 largest_difference = 0, largest = 0;
  ulong i = begin;
  for (; i + 8 <= end; i += 8) {
    const float8 x = tile_load8(raw + i);
    const float8 d = x - vload8(0, decoded + i);
    const float8 scaled = x * scale, scaled_d = d * scale;
    difference_squares = fma(scaled_d, scaled_d, difference_squares);
    reference_squares = fma(scaled, scaled, reference_squares);
    largest_difference = max(largest_difference, as_int8(fabs(d)));
    largest = max(largest, as_int8(fabs(x)));
  }
  float sums[2] = {0.0f, 0.0f};
  int maxima[2] = {0, 0};
  int d8[8], m8[8];
  vstore8(largest_difference, 0, d8);
  vstore8(largest, 0, m8);
  for (uint lane = 0; lane < 8; ++lane) {
    maxima[0] = max(maxima[0], d8[lane]);
    maxima[1] = max(maxima[1], m8[lane]);
  }
  const float4 d4 = difference_squares.lo + difference_squares.hi;
  const float4 r4 = reference_squares.lo + reference_squares.hi;
  sums[0] = (d4.x + d4.y) + (d4.z + d4.w);
  sums[1] = (r4.x + r4.y) + (r4.z + r4.w);
  for (; i < end; ++i) {
    const float x = tile_load(raw + i);
    const float d = x - decoded[i];
    sums[0] = fma(d * scale, d * scale, sums[0]);
    sums[1] = fma(x * scale, x * scale, sums[1]);
    maxima[0] = max(maxima[0], as_int(fabs(d)));
    maxima[1] = max(maxima[1], as_int(fabs(x)));
  }
  partial[chunk] = (float4)(sums[0], sums[1], as_float(maxima[0]), as_float(maxima[1]));
}
