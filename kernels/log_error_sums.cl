// Sums of the errors of a reconstruction T' against raw values T on a logarithmic scale:
//
//   partial[chunk] = (sum (l(T) - l(T'))^2, sum l(T)^2),   l(x) = sgn(x) ln(1 + |x| / s)
//
//   raw:     [count] of the stored type
//   decoded: [count] of float
//
// Work-item (chunk). Within a chunk eight lanes add up at most CHUNK / 8 squares each; the host adds
// the chunks in double.
//
// CHUNK  values of a chunk, a multiple of 8
#include "tile_values.cl"

#ifndef CHUNK
#define CHUNK 2048
#endif

inline float8 signed_log(float8 x, float s) { return copysign(log1p(fabs(x) / s), x); }

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void log_error_sums(__global const raw_t* restrict raw,
                             __global const float* restrict decoded, ulong count, float s,
                             __global float2* restrict partial) {
  const ulong chunk = get_global_id(0);
  const ulong end = min(chunk * CHUNK + CHUNK, count);
  float8 difference_squares = 0.0f, reference_squares = 0.0f;
  for (ulong i = chunk * CHUNK; i < end; i += 8) {
    float8 x, y;
    if (i + 8 <= end) {
      x = tile_load8(raw + i);
      y = vload8(0, decoded + i);
    } else {
      float last_x[8] = {0, 0, 0, 0, 0, 0, 0, 0}, last_y[8] = {0, 0, 0, 0, 0, 0, 0, 0};
      for (uint lane = 0; i + lane < end; ++lane) {
        last_x[lane] = tile_load(raw + i + lane);
        last_y[lane] = decoded[i + lane];
      }
      x = vload8(0, last_x);
      y = vload8(0, last_y);
    }
    const float8 reference = signed_log(x, s);
    const float8 difference = reference - signed_log(y, s);
    difference_squares = fma(difference, difference, difference_squares);
    reference_squares = fma(reference, reference, reference_squares);
  }
  const float4 d = difference_squares.lo + difference_squares.hi;
  const float4 r = reference_squares.lo + reference_squares.hi;
  partial[chunk] = (float2)((d.x + d.y) + (d.z + d.w), (r.x + r.y) + (r.z + r.w));
}
