// Sums of squares of a reconstruction's errors and of the values themselves, with weights of the
// texels, of each image:
//
//   partial[image][chunk] = (sum w (s (T - T'))^2, sum w (s T)^2)
//
//   raw:     [images][image_values] of the stored type
//   decoded: [images][image_values] of float
//   weights: [image_values] of float, a texel's weight once per channel
//
// s is a power of two that keeps the squares within float. Work-item (chunk, image). Within a chunk
// eight lanes add up at most CHUNK / 8 products each; the host adds the chunks in double.
//
// CHUNK  values of a chunk, a multiple of 8
#include "tile_values.cl"

#ifndef CHUNK
#define CHUNK 2048
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void weighted_squares(__global const raw_t* restrict raw,
                               __global const float* restrict decoded,
                               __global const float* restrict weights, ulong image_values,
                               float scale, __global float2* restrict partial) {
  const ulong chunk = get_global_id(0);
  const ulong image = get_global_id(1);
  const ulong end = min((chunk + 1) * CHUNK, image_values);
  raw += image * image_values;
  decoded += image * image_values;
  float8 difference_squares = 0.0f, reference_squares = 0.0f;
  ulong i = chunk * CHUNK;
  for (; i + 8 <= end; i += 8) {
    const float8 x = tile_load8(raw + i);
    const float8 w = vload8(0, weights + i);
    const float8 d = (x - vload8(0, decoded + i)) * scale;
    const float8 scaled = x * scale;
    difference_squares = fma(w * d, d, difference_squares);
    reference_squares = fma(w * scaled, scaled, reference_squares);
  }
  const float4 d4 = difference_squares.lo + difference_squares.hi;
  const float4 r4 = reference_squares.lo + reference_squares.hi;
  float difference = (d4.x + d4.y) + (d4.z + d4.w);
  float reference = (r4.x + r4.y) + (r4.z + r4.w);
  for (; i < end; ++i) {
    const float x = tile_load(raw + i);
    const float d = (x - decoded[i]) * scale;
    const float scaled = x * scale;
    difference = fma(weights[i] * d, d, difference);
    reference = fma(weights[i] * scaled, scaled, reference);
  }
  partial[image * get_global_size(0) + chunk] = (float2)(difference, reference);
}
