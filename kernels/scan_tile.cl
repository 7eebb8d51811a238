// One look at the raw values: per image and channel the sum, the largest magnitude, and the first
// value that is NaN or infinite.
//
//   sum(image, chunk, c) = sum over the chunk's texels p of T[image, p, c]
//
//   raw:  [images][P][CHANNELS]
//   sums: [images][chunks][CHANNELS] of (high, low): Kahan-compensated
//   largest:   [images][chunks], of the finite values
//   first_bad: [images][chunks], index p CHANNELS + c within the image, or 0xffffffffffffffff
//
// Work-item (chunk, image). Non-finite values count as 0 in the sums.
//
// CHANNELS    C
// CHUNK       texels of a chunk, a multiple of 8
#include "tile_values.cl"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifndef CHUNK
#define CHUNK 1024
#endif

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void scan_tile(__global const raw_t* restrict raw, ulong texels, __global float2* restrict sums,
                        __global float* restrict largest, __global ulong* restrict first_bad) {
  const ulong chunk = get_global_id(0);
  const ulong image = get_global_id(1);
  const ulong chunks = get_global_size(0);
  const ulong begin = chunk * CHUNK;
  const ulong count = min((ulong)CHUNK, texels - begin);
  __global const raw_t* values = raw + (image * texels + begin) * CHANNELS;

  // Eight texels are CHANNELS vectors; lane i of vector m belongs to channel (8 m + i) % CHANNELS.
  float8 sum[CHANNELS], low[CHANNELS];
  for (uint m = 0; m < CHANNELS; ++m) sum[m] = low[m] = 0.0f;
  float8 most = 0.0f;
  int8 bad = 0;
  const ulong groups = count / 8;
  for (ulong g = 0; g < groups; ++g) {
    for (uint m = 0; m < CHANNELS; ++m) {
      const float8 x = raw_load8(values + (g * CHANNELS + m) * 8);
      const int8 bad_lanes = non_finite8(x);
      const float8 finite = select(x, (float8)0.0f, bad_lanes);
      bad |= bad_lanes;
      const float8 magnitude = fabs(finite);
      most = magnitude > most ? magnitude : most;
      const float8 y = finite - low[m];
      const float8 t = sum[m] + y;
      low[m] = (t - sum[m]) - y;
      sum[m] = t;
    }
  }

  // The lanes by channel, then the last few texels.
  float total[CHANNELS], total_low[CHANNELS];
  for (uint c = 0; c < CHANNELS; ++c) total[c] = total_low[c] = 0.0f;
  for (uint m = 0; m < CHANNELS; ++m) {
    float s[8], l[8];
    vstore8(sum[m], 0, s);
    vstore8(low[m], 0, l);
    for (uint lane = 0; lane < 8; ++lane) {
      const uint c = (8 * m + lane) % CHANNELS;
      const float y = (s[lane] - l[lane]) - total_low[c];
      const float t = total[c] + y;
      total_low[c] = (t - total[c]) - y;
      total[c] = t;
    }
  }
  float8 lanes = most;
  float maximum = 0.0f;
  float m8[8];
  vstore8(lanes, 0, m8);
  for (uint lane = 0; lane < 8; ++lane) maximum = m8[lane] > maximum ? m8[lane] : maximum;
  int any_bad = any(bad);
  for (ulong i = groups * 8 * CHANNELS; i < count * CHANNELS; ++i) {
    const float x = raw_load(values + i);
    const uint c = (uint)(i % CHANNELS);
    if (non_finite(x)) {
      any_bad = 1;
      continue;
    }
    maximum = fabs(x) > maximum ? fabs(x) : maximum;
    const float y = x - total_low[c];
    const float t = total[c] + y;
    total_low[c] = (t - total[c]) - y;
    total[c] = t;
  }

  const ulong slot = image * chunks + chunk;
  for (uint c = 0; c < CHANNELS; ++c) {
    sums[slot * CHANNELS + c] = (float2)(total[c], -total_low[c]);
  }
  largest[slot] = maximum;
  ulong first = 0xffffffffffffffffUL;
  if (any_bad) {
    for (ulong i = 0; i < count * CHANNELS; ++i) {
      if (non_finite(raw_load(values + i))) {
        first = begin * CHANNELS + i;
        break;
      }
    }
  }
  first_bad[slot] = first;
}
